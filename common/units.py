"""Conversions between human units (YAML, reports) and integer nanoseconds (inside)."""

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
NS_PER_US = 1_000
NM_PER_MM = 1_000_000
MM_PER_M = 1_000.0


def s_to_ns(seconds: float) -> int:
    """Round a duration in seconds to integer nanoseconds."""
    return round(seconds * NS_PER_S)


def ms_to_ns(milliseconds: float) -> int:
    """Round a duration in milliseconds to integer nanoseconds."""
    return round(milliseconds * NS_PER_MS)


def sample_instant_ns(index: int, rate_hz: int) -> int:
    """Run time of sample ``index``: ``index * 10**9 // rate_hz``, so that no rounding error accumulates."""
    return index * NS_PER_S // rate_hz


def sample_index(instant_ns: int, rate_hz: int) -> int:
    """Return the number of the sample nearest to ``instant_ns``: the inverse of `sample_instant_ns`."""
    return (2 * instant_ns * rate_hz + NS_PER_S) // (2 * NS_PER_S)
