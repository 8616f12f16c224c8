"""Activity of a hand relative to the training rows: a factor on the model's covariances, estimated during a run.

One surgeon moves twice as fast as another, but a model has one covariance of the innovations. The activity is a
running mean, over a minute, of squared innovations in units of their expectation; it starts at 1. It scales the
covariance of a forecast and never the forecast itself.
"""

from dataclasses import dataclass

Activity = tuple[float, float]
"""The factor on covariances, and the number of samples it is a mean over, the first guess included."""

_FIRST_S = 2
_REMEMBERED_S = 60
_MAX_SURPRISE = 30.0
"""Bounds the effect of a single jump, for example of a released clutch."""


@dataclass(frozen=True)
class ActivityMean:
    """A running mean of surprises: squared innovations over their expectation. Oracle: the plain mean."""

    first: float
    longest: float

    @classmethod
    def at_rate(cls, rate_hz: int) -> "ActivityMean":
        """Return the mean that starts with a weight of 2 s and grows to a window of 60 s."""
        return cls(float(_FIRST_S * rate_hz), float(_REMEMBERED_S * rate_hz))

    def initial(self) -> Activity:
        """Return the activity of the training rows."""
        return 1.0, self.first

    def after(self, activity: Activity, surprise: float) -> Activity:
        """Return the activity after one more surprise."""
        factor, n_samples = activity
        if n_samples < self.longest:
            n_samples += 1.0
        if surprise > _MAX_SURPRISE:
            surprise = _MAX_SURPRISE
        return factor + (surprise - factor) / n_samples, n_samples
