"""The surgeon's display: delayed feedback and predicted arm, and their errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand, is_predicted
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.tracking import SETTLING_NS, truth_at
from tis.common.records import FRESH, PLANT
from tis.common.units import MM_PER_M, NS_PER_MS
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.numbers import number
from tis.deploy.present.table import Table
from tis.deploy.report.section import Section, Statistics, means, statistics
from tis.deploy.report.subjects.tracking import at_ticks

_ERRORS: Final = "rms p50 p95 max"


class DisplayErrors(Section):
    """Distances of what is shown to the arm."""

    at_effect: Statistics = statistics(
        "To where the arm is at the patient's first tick that has the command of the surgeon's tick, or a newer one.",
        _ERRORS,
    )
    now: Statistics = statistics("To where the arm is at the surgeon's tick.", _ERRORS)


class DisplayFigures(Section):
    """The display of a hand."""

    n: int = means(
        "Ticks of the surgeon that are scored, from 2 s after the first display on, and of them those "
        "whose command took effect."
    )
    late_ms: Statistics = statistics(
        "How late the surgeon sees the arm, from the newest command behind the feedback that is shown to the "
        "surgeon's tick; it grows while nothing arrives."
    )
    round_trip_ms: Statistics = statistics(
        "From that command to the arrival of the feedback, by the surgeon's clock."
    )
    feedback_mm: DisplayErrors = means("Error of the delayed feedback.")
    predicted_mm: DisplayErrors = means("Error of the predicted arm.")
    ratio: float | None = means("RMS of the prediction's error over that of the feedback's, at effect.")


_NOTE: Final = (
    "At effect: distance to where the arm is at the patient's first tick that has the command given at that moment. "
    "Now: to where it is at that moment. The prediction adds to the feedback what was commanded since"
)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Displayed:
    """One hand's display at the surgeon's ticks (N,): instants in ns, positions (N, 3) in m, NaN where not known.

    ``command_ns`` is the sample instant of the newest command behind the feedback shown, ``round_trip_ns`` the time
    from then to its arrival. ``shown_m`` is the delayed feedback, ``predicted_m`` the prediction, ``now_m`` the arm
    at that instant, and ``effect_m`` the arm at the patient's first tick that has the command of that instant, or a
    newer one.
    """

    sample_ns: Ints
    command_ns: Ints
    round_trip_ns: Ints
    shown_m: Array
    predicted_m: Array
    now_m: Array
    effect_m: Array


def displayed(logs: RunLogs, hand: Hand) -> Displayed | None:
    """Return a hand's display beside the arm; None where the surgeon's log holds none."""
    rows = logs.of_arm("surgeon", is_predicted, hand)
    if rows is None:
        return None
    shown, arm = rows.first_of_each("sample_ns"), logs.of_hand("patient", PLANT, hand).first_of_each("tick")
    now_m = truth_at(shown.sample_ns, arm.t_ns, arm.position_m) if len(arm) else np.full((len(shown), 3), np.nan)
    effect_m = at_ticks(_effect_ticks(logs, hand, shown.sample_ns), arm, "position_m")
    return Displayed(
        shown.sample_ns, shown.command_ns, shown.round_trip_ns, shown.shown_m, shown.position_m, now_m, effect_m
    )


def display_summary(logs: RunLogs, hands: Mapping[Hand, Any]) -> dict[Hand, DisplayFigures | None]:
    """Return by hand the errors of feedback and prediction in mm, from 2 s after the first display on.

    A command that never took effect, as it was sent in the last moments, is left out of ``at_effect``. Oracle: arms
    of known motion, computed by hand (tests/deploy/report/subjects/test_display).
    """
    found: dict[Hand, DisplayFigures | None] = {}
    for hand in hands:
        display = displayed(logs, hand)
        if display is None:
            found[hand] = None
            continue
        scored = display.sample_ns >= display.sample_ns[0] + SETTLING_NS
        errors = {
            name: DisplayErrors(
                at_effect=_errors_mm(where_m[scored], display.effect_m[scored]),
                now=_errors_mm(where_m[scored], display.now_m[scored]),
            )
            for name, where_m in (("feedback_mm", display.shown_m), ("predicted_mm", display.predicted_m))
        }
        both = [errors[name].at_effect["rms"] for name in ("predicted_mm", "feedback_mm")]
        found[hand] = DisplayFigures(
            n=int(np.count_nonzero(scored & np.isfinite(display.effect_m).all(axis=1))),
            late_ms=summarise((display.sample_ns - display.command_ns)[scored] / NS_PER_MS),
            round_trip_ms=summarise(display.round_trip_ns[scored] / NS_PER_MS),
            **errors,
            ratio=both[0] / both[1] if both[0] is not None and both[1] else None,
        )
    return found


def _errors_mm(where_m: Array, arm_m: Array) -> dict[str, Any]:
    error_mm = MM_PER_M * np.linalg.norm(where_m - arm_m, axis=1)
    error_mm = error_mm[np.isfinite(error_mm)]
    rms = float(np.sqrt(np.mean(error_mm**2))) if len(error_mm) else None
    return {"rms": rms, **summarise(error_mm, (50, 95), ("max",))}


def _effect_ticks(logs: RunLogs, hand: Hand, sample_ns: Ints) -> Ints:
    """Return the patient's first tick with a sample at or after each instant (N,); -1 where there is none."""
    fresh = logs.of_hand("patient", FRESH, hand)
    order = np.argsort(fresh.tick, kind="stable")
    tick, place = fresh.tick[order], np.searchsorted(np.maximum.accumulate(fresh.sample_ns[order]), sample_ns)
    return np.where(place < len(tick), tick[np.minimum(place, len(tick) - 1)], -1) if len(tick) else 0 * sample_ns - 1


def display_tables(display: Mapping[Hand, DisplayFigures | None]) -> list[Table]:
    """Return a table for each hand with a display: a row for the feedback and one for the prediction."""
    columns = ("shown", "RMS at effect", "median", "p95", "max", "RMS now")
    tables = []
    for hand, found in display.items():
        if found is None or not found.n:
            continue
        rows = [
            (title, *(one.at_effect[name] for name in ("rms", "p50", "p95", "max")), one.now["rms"])
            for title, one in (("delayed feedback", found.feedback_mm), ("predicted arm", found.predicted_mm))
        ]
        late = f"Seen late by {number(found.late_ms['p50'])} ms (median)"
        tables.append(Table(f"The surgeon's display, mm, {hand} hand", columns, rows, f"{_NOTE}. {late}"))
    return tables
