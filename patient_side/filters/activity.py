"""How lively a hand is now, against the training rows: a factor on the model's covariances, learnt in a run.

One surgeon moves twice as fast as another, and a model has one covariance of the innovations. So the squares of the
innovations over their expectations are followed as they come, from 1, as a running mean that forgets after a minute.
It changes how certain a forecast claims to be and never the forecast.
"""

from dataclasses import dataclass

Activity = tuple[float, float]
"""The factor on covariances, and over how many samples, the first guess included, it is a mean."""

_FIRST_S = 2
_REMEMBERED_S = 60
_LARGEST = 30.0
"""A single jump, as of a released clutch, counts no more than this."""


@dataclass(frozen=True)
class ActivityMean:
    """A running mean of surprises, squares of innovations that are 1 on average. Oracle: the plain mean."""

    first: float
    longest: float

    @classmethod
    def at_rate(cls, rate_hz: int) -> "ActivityMean":
        """Return the mean that begins with the weight of 2 s and goes over 60 s in the end."""
        return cls(float(_FIRST_S * rate_hz), float(_REMEMBERED_S * rate_hz))

    def initial(self) -> Activity:
        """Return the activity of the training rows."""
        return 1.0, self.first

    def after(self, activity: Activity, surprise: float) -> Activity:
        """Return the activity after one more innovation."""
        factor, n_samples = activity
        if n_samples < self.longest:
            n_samples += 1.0
        if surprise > _LARGEST:
            surprise = _LARGEST
        return factor + (surprise - factor) / n_samples, n_samples
