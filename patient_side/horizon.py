"""Time limits of all estimators: the horizon of forecasts, and the wait for late commands."""

HORIZON_S = 5
MAX_HORIZON_SAMPLES = 2000
"""Bounds the filter's tables and the work of a tick at rates above 400 Hz."""

PATIENCE_SAMPLES = 60
"""Samples for which an arm sample waits for its command before the filter uses it alone: 2 s at 30 Hz."""


def horizon_samples(rate_hz: int) -> int:
    """Return the number of samples beyond which a forecast stays constant: 5 s, at most 2000 samples."""
    return min(HORIZON_S * rate_hz, MAX_HORIZON_SAMPLES)
