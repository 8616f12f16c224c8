"""Counts, spans, limits and statistics as text: about 30 million messages, 5.8 days at this rate."""

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
"""Unit of counting of each metric of `tis.common.scenario.limits`: it has one value for each."""

_SCALES: Final = ((1e9, "billion"), (1e6, "million"))
_SPANS: Final = ((365.25 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
_EXACT_BELOW: Final = 1000


def statistic_name(name: str) -> str:
    """Return the word for a statistic of the summary: median for ``p50``; mean, std, p95, p99 and max are words."""
    return "median" if name == "p50" else name


def percentile_name(percent: float | None) -> str:
    """Return the word for a percentile: ``p99`` for 99; "" for None."""
    return "" if percent is None else statistic_name(f"p{percent:g}")


def plain_number(value: float, digits: int = 3) -> str:
    """Return a number with ``digits`` significant digits, integer digits always complete, without exponent."""
    return np.format_float_positional(float(f"{value:.{digits}g}") if abs(value) < 1000 else round(value), trim="-")


def limit_text(value: float, unit: str) -> str:
    """Return a limit in words, unrounded."""
    return f"allowed {plain_number(value, 6)} {unit}"


def rounded_count(n: int) -> str:
    """Return a count with two significant digits: 299, 3000, 30 million (oracle: literals, test_amounts)."""
    if n < _EXACT_BELOW:
        return str(n)
    shown = float(f"{n:.2g}")
    for scale, name in _SCALES:
        if shown >= scale:
            return f"{shown / scale:.3g} {name}"
    return f"{shown:.0f}"


def rounded_span(seconds: float) -> str:
    """Return a time in the largest unit that it fills: 3 s, 4.2 h, 5.8 days."""
    unit_s, name = next(((unit_s, name) for unit_s, name in _SPANS if seconds >= unit_s), _SPANS[-1])
    value = seconds / unit_s
    return f"{value:.2g} {name}" if value < _EXACT_BELOW else f"{rounded_count(round(value))} {name}"


def needed_count(n_needed: int, metric: str) -> str:
    """Return the number of values needed in all."""
    return f"about {rounded_count(n_needed)} {COUNTED[metric]}"


def needed_time(n_needed: int, n: int, over_s: float | None) -> str:
    """Return the time that they take at the rate of ``n`` in ``over_s``; "" when it is unknown."""
    return f", {rounded_span(n_needed * over_s / n)} at this rate" if over_s and n else ""
