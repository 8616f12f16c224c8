"""Table of the key figures of several runs, with differences to the first run."""

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from tis.deploy.report.run_view import RunView
from tis.deploy.report.tables.answer import accuracy_by_hand
from tis.deploy.report.tables.html_tables import table
from tis.deploy.report.tables.numbers import number
from tis.deploy.report.tables.redundancy_rows import kilo
from tis.deploy.report.verdict.verdict_text import outcome_text

_SAME: Final = 0.005
Values = Sequence[float | None]
Difference = Callable[[float, float], str]


def in_percent(first: float, value: float) -> str:
    """Return a relative change in per cent; the change itself when the first value is 0."""
    if not first:
        return f"{value - first:+.3g}"
    share = value / first - 1
    return "\u00b10 %" if abs(share) < _SAME else f"{100 * share:+.0f} %"


def in_points(first: float, value: float) -> str:
    """Return a change in percentage points: from 1.0 % to 1.2 % is 0.2 points, not 20 %."""
    points = value - first
    return "\u00b10 points" if abs(points) < _SAME else f"{points:+.{1 if abs(points) >= 10 else 2}f} points"


def in_number(first: float, value: float) -> str:
    """Return the change of a count."""
    return f"{value - first:+g}"


class _Row(NamedTuple):
    """A row: its figure in a summary, and the form of its difference."""

    value: Callable[[dict[str, Any]], float | None]
    difference: Difference = in_percent


_ROWS: Final[dict[str, _Row]] = {
    "end-to-end latency, median, ms": _Row(lambda s: s["latency_ms"]["end_to_end"]["p50"]),
    "end-to-end latency, p99, ms": _Row(lambda s: s["latency_ms"]["end_to_end"]["p99"]),
    "network's part, median, ms": _Row(lambda s: s["latency_ms"]["network"]["p50"]),
    "wait for the tick, median, ms": _Row(lambda s: s["latency_ms"]["tick_wait"]["p50"]),
    "round trip, median, ms": _Row(lambda s: s["latency_ms"]["round_trip"]["p50"]),
    "age at the tick, max, ms": _Row(lambda s: s["age_ms"]["max"]),
    "age at the tick, p95, ms": _Row(lambda s: s["age_ms"]["p95"]),
    "packets/s sent by the surgeon": _Row(lambda s: s["redundancy"]["price"]["packets_per_s"]),
    "kB/s sent by the surgeon": _Row(lambda s: kilo(s["redundancy"]["price"]["bytes_per_s"])),
    "samples that never arrived, %": _Row(lambda s: s["redundancy"]["lost"]["samples_pct"], in_points),
    "packets lost forward, %": _Row(lambda s: s["links"]["forward"]["loss_pct"], in_points),
    "packets lost back, %": _Row(lambda s: s["links"]["feedback"]["loss_pct"], in_points),
    "longest run of losses forward": _Row(lambda s: s["links"]["forward"]["loss_runs"]["longest"], in_number),
    "ticks missed by the patient": _Row(lambda s: s["ticks"]["missed"], in_number),
}


def figures_table(names: Sequence[str], runs: Sequence[RunView]) -> str:
    """Return a column for each run, with the difference to the first run where both have the figure."""
    figures = {
        title: ([value(run.summary) for run in runs], difference) for title, (value, difference) in _ROWS.items()
    }
    rows = [(title, *compared(*one)) for title, one in (figures | _accuracy(runs)).items()]
    note = (
        '<p class="note">In brackets the difference to the first run: in percentage points for shares, as a number '
        "for counts, else in per cent of the first run's figure. End to end: from the newest sample behind an "
        "estimate to its publication.</p>"
    )
    judged = [("a valid measurement", *("yes" if run.summary["valid"] else "no" for run in runs))]
    judged += [(title, *outcomes) for title, outcomes in _outcomes(runs).items()]
    words = range(1, len(names) + 1)
    return (
        table("Key figures, and the difference to the first run", ("figure", *names), rows)
        + note
        + table("Validity, and requirements of applications", ("requirements", *names), judged, texts=words)
    )


def compared(values: Values, difference: Difference) -> list[str]:
    """Return figures as text, each but the first with its difference to the first if both are known."""
    first = values[0]
    return [number(first), *(f"{number(value)}{_difference(first, value, difference)}" for value in values[1:])]


def _difference(first: float | None, value: float | None, difference: Difference) -> str:
    if first is None or value is None:
        return ""
    return " (same)" if value == first else f" ({difference(first, value)})"


def _accuracy(runs: Sequence[RunView]) -> dict[str, tuple[Values, Difference]]:
    """Return the errors of each hand's estimators in any of the runs, active ones first."""
    found = [accuracy_by_hand(run.summary, run.scenario) for run in runs]
    hands = dict.fromkeys(hand for one in found for hand in one)
    active = dict.fromkeys(run.scenario.active_estimator for run in runs)
    others = dict.fromkeys(name for one in found for scores in one.values() for name in scores)
    rows: dict[str, tuple[Values, Difference]] = {}
    for hand in hands:
        for name in active | others:
            errors = [one.get(hand, {}).get(name, {}).get("rmse_3d_mm") for one in found]
            if any(error is not None for error in errors):
                rows[f"RMSE of {name} in 3D, {hand} hand, mm"] = errors, in_percent
        for name in active:
            ratios = [one.get(hand, {}).get(name, {}).get("ratio_to_hold") for one in found]
            shares = [None if ratio is None else 100 * ratio for ratio in ratios]
            rows[f"RMSE of {name} in 3D, {hand} hand, % of hold"] = shares, in_points
    return rows


def _outcomes(runs: Sequence[RunView]) -> dict[str, list[str]]:
    found = [
        {v["title"]: outcome_text(v, run.summary["ticks"]["rate_hz"]) for v in run.summary["verdicts"]}
        for run in runs
    ]
    titles = dict.fromkeys(title for one in found for title in one)
    return {title: [one.get(title, "-") for one in found] for title in titles}
