"""How many more it takes to decide, as people say it: about 30 million messages, 5.8 days at this rate."""

from typing import Final

import numpy as np

COUNTED: Final[dict[str, str]] = {
    "one_way": "messages",
    "pdv": "messages",
    "loss": "messages",
    "end_to_end": "estimates",
    "round_trip": "round trips",
    "network_round_trip": "round trips",
    "age": "ticks",
    "rmse_3d": "ticks",
}
"""What each metric of `common.scenario.requirements` is taken over: one value for each of them."""

_SCALES: Final = ((1e9, "billion"), (1e6, "million"))
_SPANS: Final = ((365.25 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
_EXACT_BELOW: Final = 1000


def statistic_name(name: str) -> str:
    """Return the word for a statistic of the summary: median for ``p50``; mean, std, p95, p99 and max are words."""
    return "median" if name == "p50" else name


def percentile_name(percent: float | None) -> str:
    """Return the word for a percentile: ``p99`` for 99; "" for None."""
    return "" if percent is None else statistic_name(f"p{percent:g}")


def plain(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, all before the point, and never a power of ten."""
    return np.format_float_positional(float(f"{value:.{digits}g}") if abs(value) < 1000 else round(value), trim="-")


def limit(value: float, unit: str) -> str:
    """Return what is allowed, in words; a limit is shown as it was given."""
    return f"allowed {plain(value, 6)} {unit}"


def rounded_count(n: int) -> str:
    """Return a number as it is said: 299, 3000, 30 million (oracle: literals, the tests)."""
    if n < _EXACT_BELOW:
        return str(n)
    shown = float(f"{n:.2g}")
    for scale, name in _SCALES:
        if shown >= scale:
            return f"{shown / scale:.3g} {name}"
    return f"{shown:.0f}"


def rounded_span(seconds: float) -> str:
    """Return a time as it is said, in the largest unit of which it is at least one: 3 s, 4.2 h, 5.8 days."""
    unit_s, name = next(((unit_s, name) for unit_s, name in _SPANS if seconds >= unit_s), _SPANS[-1])
    value = seconds / unit_s
    return f"{value:.2g} {name}" if value < _EXACT_BELOW else f"{rounded_count(round(value))} {name}"


def needed_count(n_needed: int, metric: str) -> str:
    """Return how many are needed in all."""
    return f"about {rounded_count(n_needed)} {COUNTED[metric]}"


def needed_time(n_needed: int, n: int, over_s: float | None) -> str:
    """Return how long that takes at the rate of the ``n`` met in ``over_s``; nothing where that is not known."""
    return f", {rounded_span(n_needed * over_s / n)} at this rate" if over_s and n else ""
