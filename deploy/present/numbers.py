"""Numbers as text: significant digits, intervals, counts, spans of time, and the names of statistics."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

NONE: Final = "-"
"""Text of a value that does not exist."""

_SCALES: Final = ((1e9, "billion"), (1e6, "million"))
_SPANS: Final = ((365.25 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
_EXACT_BELOW: Final = 1000
_SMALL: Final = 5e-4
"""What would be shown as 0.000; below `_LEAST`, which rounding of floating-point numbers causes, it is."""
_LEAST: Final = 1e-6
_DIVERGED: Final = 1e4
"""Figures of a filter that has diverged, whose digits say nothing."""


def number(value: float | None, unit: str = "") -> str:
    """Return a number with three or four significant digits, one if it is small, a dash for none; only 0 is 0."""
    if value is None:
        return NONE
    if isinstance(value, int) or value == 0.0:
        return f"{value or 0}{unit}"
    digits = 0 if abs(value) >= 1000 else 1 if abs(value) >= 100 else 2 if abs(value) >= 1 else 3
    if _LEAST <= abs(value) < _SMALL:
        digits = -math.floor(math.log10(abs(value)))
    if 99.9 <= value < 100 and not unit:
        digits, value = 3, math.floor(1000 * value) / 1000  # only a full 100 is shown as 100
    return f"{value:.{digits}f}{unit}"


def counted(n: int | None, noun: str) -> str:
    """Return a number with its noun, in the plural unless it is one: ``1 run``, ``0 runs``."""
    return f"{number(n)} {noun}{'s' * (n != 1)}"


def with_margin(value: float | None, margin: float | None) -> str:
    """Return a number with its margin, ``0.31 \u00b1 0.02``, if it has one."""
    return number(value) + (f" \u00b1 {number(margin)}" if margin else "")


def shown(value: Any) -> str:
    """Return the value of a cell as text: text as it is, a number by `number`, a dash for None."""
    if isinstance(value, str):
        return value
    return ("no", "yes")[value] if isinstance(value, bool) else number(value)


def known(value: float | None) -> str:
    """Return a number with four significant digits, a question mark for one that is not known (None, NaN)."""
    return "?" if value is None or math.isnan(value) else f"{value:.4g}"


def fixed(value: float | None, digits: int, below: float = _DIVERGED) -> str:
    """Return a number with ``digits`` decimals, a dash for none, a power of ten from ``below`` on."""
    if value is None:
        return NONE
    return f"{value:.{digits}f}" if abs(value) < below else f"{value:.0e}"


def significant(value: float, digits: int = 3) -> str:
    """Return a number with ``digits`` significant digits, integer digits always complete, without exponent."""
    from numpy import format_float_positional  # start-up of commands that show no number

    return format_float_positional(float(f"{value:.{digits}g}") if abs(value) < 1000 else round(value), trim="-")


def rounded_up(value: float, digits: int) -> str:
    """Return a value with ``digits`` decimals, rounded up as bounds must be."""
    return f"{math.ceil(round(value * 10**digits, 6)) / 10**digits:.{digits}f}"


def percent(ratio: float | None, fine: bool = False) -> str:
    """Return a ratio in per cent without its sign, a dash for none; ``fine``: with a decimal below 10.

    Below 1 it has a significant digit: nothing but 0 is 0 %.
    """
    if ratio is None:
        return NONE
    return f"{100 * ratio:.1g}" if 0 < ratio < 0.0095 else f"{100 * ratio:.{int(fine and ratio < 0.1)}f}"


def per_axis(values: Iterable[float | None], digits: int = 2) -> str:
    """Return one number for each axis, as of `fixed`."""
    return " ".join(fixed(value, digits) for value in values)


def interval(bounds: Sequence[float | None] | None) -> str:
    """Return an interval as ``low to high``; a dash for none or an unknown bound."""
    return NONE if bounds is None or None in bounds else f"{number(bounds[0])} to {number(bounds[1])}"


def with_interval(value: float | None, bounds: Sequence[float | None] | None, digits: int = 3) -> str:
    """Return a value with its interval, ``0.812 (0.790-0.833)``; a dash for none."""
    if value is None or bounds is None or None in bounds:
        return NONE if value is None else f"{value:.{digits}f}"
    return f"{value:.{digits}f} ({bounds[0]:.{digits}f}-{bounds[1]:.{digits}f})"


def rounded_count(n: int) -> str:
    """Return a count with two significant digits: 299, 3000, 30 million (oracle: literals, test_numbers)."""
    if n < _EXACT_BELOW:
        return str(n)
    rounded = float(f"{n:.2g}")
    for scale, name in _SCALES:
        if rounded >= scale:
            return f"{rounded / scale:.3g} {name}"
    return f"{rounded:.0f}"


def rounded_span(seconds: float) -> str:
    """Return a time in the largest unit that it fills: 3 s, 4.2 h, 5.8 days."""
    unit_s, name = next(((unit_s, name) for unit_s, name in _SPANS if seconds >= unit_s), _SPANS[-1])
    value = seconds / unit_s
    return f"{value:.2g} {name}" if value < _EXACT_BELOW else f"{rounded_count(round(value))} {name}"


def statistic_name(name: str) -> str:
    """Return the word for a statistic of the summary: median for ``p50``; mean, std, p95, p99 and max are words."""
    return "median" if name == "p50" else name


def percentile_name(percent: float | None) -> str:
    """Return the word for a percentile: ``p99`` for 99; "" for None."""
    return "" if percent is None else statistic_name(f"p{percent:g}")


def heads(names: Iterable[str], unit: str = "") -> tuple[str, ...]:
    """Return the column heads of statistics, with ``unit`` if there is one."""
    return tuple(f"{statistic_name(name)}, {unit}" if unit else statistic_name(name) for name in names)


def broken_name(name: str, width: int) -> str:
    """Return a name with line breaks where it exceeds ``width``: after its colon, then every ``width`` characters."""
    parts = [name] if len(name) <= width else name.replace(":", ":\n").split("\n")
    return "\n".join(part[at : at + width] for part in parts for at in range(0, len(part), width))
