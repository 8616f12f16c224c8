"""How far estimators look ahead of the freshest sample, and how far back they wait for late ones."""

HORIZON_S = 5
LONGEST_HORIZON_SAMPLES = 2000
"""Bounds the filter's tables and the work of a tick at rates above 400 Hz."""


PATIENCE_SAMPLES = 60
"""How long arm samples wait for their commands before they are used without: 2 s at 30 Hz."""


def horizon_samples(rate_hz: int) -> int:
    """Return the number of samples beyond which a forecast stays where it is: 5 s, at most 2000 samples."""
    return min(HORIZON_S * rate_hz, LONGEST_HORIZON_SAMPLES)
