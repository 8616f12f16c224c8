"""Tables of the estimators' accuracy: errors beside hold's, offsets, consistency."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, Final

from tis.common.channels import Hand
from tis.deploy.report.measures.estimation.own_estimators import labelled
from tis.deploy.report.palette import Look, look_of
from tis.deploy.report.tables.html_tables import folded, interval, markup_table, table
from tis.deploy.report.tables.numbers import number
from tis.deploy.report.tables.terminal import has_step_times

_MAX_BAR: Final = 3
_CUT: Final = "\u00bb"


def accuracy_table(accuracy: Mapping[str, Any], which: str, active: str) -> str:
    """Return one hand's estimators beside hold, with the error as a bar.

    Bars end at `_MAX_BAR` times hold's error, so that one very bad estimator does not shorten all others; longer bars
    are cut, marked and explained in a note.
    """
    errors = {name: entry["rmse_3d_mm"] for name, entry in accuracy.items() if entry["rmse_3d_mm"] is not None}
    largest = max(errors.values(), default=0.0) or 1.0
    longest = min(largest, _MAX_BAR * errors["hold"]) if errors.get("hold") else largest
    timed = has_step_times(accuracy)
    rows = [
        (
            _breakable(labelled(name, entry)),
            _marked(entry["rmse_3d_mm"], longest) + _bar(entry["rmse_3d_mm"], longest, look_of(name, list(accuracy))),
            _percent(entry["ratio_to_hold"]),
            *(number(value) for value in entry["r2_pct"]),
            number(entry.get("n_scored")),
            number(entry.get("n_missing")),
            *([number(entry.get("step_us", {}).get("p50"))] if timed else []),
        )
        for name, entry in accuracy.items()
    ]
    head = (
        "estimator", "RMSE in 3D, mm", "share of hold's error, %", "R\u00b2 x, %", "R\u00b2 y, %", "R\u00b2 z, %",
        "ticks", "missing", *(["step, median, \u00b5s"] if timed else []),
    )  # fmt: skip
    marked = _breakable(labelled(active, accuracy.get(active, {})))
    found = markup_table(f"Accuracy at the tick, {which}", head, rows, marked=marked)
    if largest <= longest:
        return found
    return f'{found}<p class="note">Bars end at {_MAX_BAR} times hold\'s error; longer ones are cut ({_CUT}).</p>'


def more_accuracy(by_hand: Mapping[Hand, Any], active: str) -> str:
    """Return a folded section: largest errors, time and value offsets and consistency of each hand."""
    parts = []
    for hand, accuracy in by_hand.items():
        parts.append(_offsets(accuracy, f"{hand} hand", active))
        parts.append(_consistency(accuracy, f"{hand} hand"))
    return folded("More about the accuracy", "".join(parts))


def _offsets(accuracy: Mapping[str, Any], which: str, active: str) -> str:
    rows = []
    for name, entry in accuracy.items():
        offset = entry.get("offset") or {}
        time_ms = offset.get("time_ms") or {}
        rows.append(
            (
                name,
                number(entry.get("max_3d_mm")),
                number(entry.get("r2_3d_pct")),
                number(entry.get("nrmse_fit_3d_pct")),
                number(time_ms.get("p50")),
                number(time_ms.get("p95")),
                number(offset.get("value_rms_mm")),
            )
        )
    head = (
        "estimator", "max error, mm", "R\u00b2 in 3D, %", "fit (NRMSE), %", "late by, median, ms", "late by, p95, ms",
        "wrong beyond that, RMS, mm",
    )  # fmt: skip
    note = (
        '<p class="note">Late by: the shift in time that explains most of the error at each instant (effective time '
        "offset); the rest is an error in value.</p>"
    )
    return table(f"Errors and offsets, {which}", head, rows, marked=active) + note


def _consistency(accuracy: Mapping[str, Any], which: str) -> str:
    rows = []
    for name, entry in accuracy.items():
        for kind in ("nees", "nis"):
            found = entry.get(kind)
            if not found or not found.get("n"):
                continue
            for i, axis in enumerate("xyz"):
                rows.append(
                    (
                        f"{name}, {kind.upper()} {axis}",
                        number(found["mean"][i]),
                        _bounds(found["bounds_95"][i]),
                        number(found["coverage_pct"][i]),
                        _bounds(found["coverage_pct_interval_95"][i]),
                        {True: "yes", False: "no", None: "-"}[found["consistent"][i]],
                    )
                )
    if not rows:
        return ""
    bounds = ("its 95 % bounds", "in the 95 % interval, %", "its interval, %")
    head = ("filter", "mean, should be 1", *bounds, "consistent")
    note = (
        '<p class="note">Does the filter state its own error correctly? Above 1 it is overconfident, below 1 '
        "underconfident. "
        "NEES: its errors, NIS: its innovations, each in units of its own variance.</p>"
    )
    return table(f"Consistency, {which}", head, rows, texts=(5,)) + note


def _breakable(name: str) -> str:
    """Return a name as markup with a possible line break after its colon."""
    return escape(name).replace(":", ":<wbr>")


def _bounds(bounds: Sequence[float] | None) -> str:
    return "-" if bounds is None or None in bounds else interval(bounds)


def _percent(ratio: float | None) -> str:
    return "-" if ratio is None else f"{100 * ratio:.0f}" if ratio >= 0.1 else f"{100 * ratio:.1f}"


def _marked(value: float | None, longest: float) -> str:
    """Return a value, with a mark if its bar is cut."""
    return f"{_CUT} {number(value)}" if value is not None and value > longest else number(value)


def _bar(value: float | None, longest: float, look: Look) -> str:
    """Return a bar in the estimator's colour; hidden from screen readers, as the number is beside it."""
    share = 0.0 if value is None else 100 * value / longest
    colour = f"light-dark({look.tone.light},{look.tone.dark})"
    length = f'<i style="width:{min(share, 100.0):.1f}%"></i>'
    return f'<span class="bar" aria-hidden="true" style="color:{colour}">{length}</span>'
