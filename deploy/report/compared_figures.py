"""The key figures of several runs in rows, each beside its difference to the first run's."""

from collections.abc import Callable, Sequence
from typing import Any, Final

from deploy.report.answer import accuracy_by_hand
from deploy.report.html_tables import table
from deploy.report.run_view import RunView
from deploy.report.table import number

_SAME: Final = 0.005
Value = Callable[[dict[str, Any]], float | None]

_ROWS: Final[dict[str, Value]] = {
    "end-to-end latency, median, ms": lambda s: _float(s["latency_ms"]["end_to_end"]["p50"]),
    "end-to-end latency, 99 %, ms": lambda s: _float(s["latency_ms"]["end_to_end"]["p99"]),
    "network's part, median, ms": lambda s: _float(s["latency_ms"]["network"]["p50"]),
    "wait for the tick, median, ms": lambda s: _float(s["latency_ms"]["tick_wait"]["p50"]),
    "round trip, median, ms": lambda s: _float(s["latency_ms"]["round_trip"]["p50"]),
    "age at the tick, largest, ms": lambda s: _float(s["age_ms"]["max"]),
    "lost forward, %": lambda s: _float(s["links"]["forward"]["loss_pct"]),
    "lost back, %": lambda s: _float(s["links"]["feedback"]["loss_pct"]),
    "longest run of losses forward": lambda s: _float(s["links"]["forward"]["loss_runs"]["longest"]),
    "ticks missed": lambda s: _float(s["ticks"]["missed"]),
}


def figures_table(names: Sequence[str], runs: Sequence[RunView]) -> str:
    """Return a column for each run; a figure that the first run has too has its difference beside it."""
    rows = [("valid measurement", *("yes" if run.summary["valid"] else "no" for run in runs))]
    rows += [(title, *_compared([value(run.summary) for run in runs])) for title, value in _ROWS.items()]
    for title, values in _accuracy(runs).items():
        rows.append((title, *_compared(values)))
    for title, outcomes in _outcomes(runs).items():
        rows.append((title, *outcomes))
    return table("Key figures, and the difference to the first run", ("", *names), rows)


def _compared(values: Sequence[float | None]) -> list[str]:
    first = values[0]
    return [number(values[0]), *(f"{number(value)}{_difference(first, value)}" for value in values[1:])]


def _difference(first: float | None, value: float | None) -> str:
    if first is None or value is None:
        return ""
    if value == first:
        return " (same)"
    if not first:
        return f" ({value - first:+.3g})"
    share = value / first - 1
    return " (\u00b10 %)" if abs(share) < _SAME else f" ({100 * share:+.0f} %)"


def _accuracy(runs: Sequence[RunView]) -> dict[str, list[float | None]]:
    """Return the error of each hand's estimators, those that act first, where any run has them."""
    found = [accuracy_by_hand(run.summary, run.scenario) for run in runs]
    hands = dict.fromkeys(hand for one in found for hand in one)
    acting = dict.fromkeys(run.scenario.active_estimator for run in runs)
    others = dict.fromkeys(name for one in found for scores in one.values() for name in scores)
    rows: dict[str, list[float | None]] = {}
    for hand in hands:
        for name in acting | others:
            errors = [one.get(hand, {}).get(name, {}).get("rmse_3d_mm") for one in found]
            if any(error is not None for error in errors):
                rows[f"error of {name}, {hand} hand, mm"] = errors
        for name in acting:
            ratios = [one.get(hand, {}).get(name, {}).get("ratio_to_hold") for one in found]
            shares = [None if ratio is None else 100 * ratio for ratio in ratios]
            rows[f"error of {name}, {hand} hand, % of hold's"] = shares
    return rows


def _outcomes(runs: Sequence[RunView]) -> dict[str, list[str]]:
    found = [{v["title"]: v["outcome"].replace("_", " ") for v in run.summary["verdicts"]} for run in runs]
    titles = dict.fromkeys(title for one in found for title in one)
    return {f"required by {title}": [one.get(title, "-") for one in found] for title in titles}


def _float(value: float | None) -> float | None:
    return value
