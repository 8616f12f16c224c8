"""Safety: what drove the arms beside the estimates, the safety states, and the emergency stops."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, sqrt
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand, is_set_point
from tis.common.messages import SafetyMode
from tis.common.safety_records import SAFETY, STOPS
from tis.common.scenario import Scenario
from tis.common.units import MM_PER_M, NS_PER_MS
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import place_in
from tis.deploy.present.numbers import number
from tis.deploy.report.section import KindName, Section, means
from tis.deploy.report.subjects.audit import releasers
from tis.deploy.report.subjects.logs import counters_of
from tis.deploy.report.subjects.tracking import Array, HandTrack, at_ticks
from tis.patient_side.identification.dataset import trained
from tis.patient_side.safety.limits import Limits, limits_of
from tis.patient_side.statespace import ArmModel

_MOST_LIMITED: Final = 0.01
"""Share of the ticks above which limits of the set point are worth a warning."""
_ROUNDING: Final = 1e-6


class StopFigures(Section):
    """The emergency stops of a hand, beside what the limits allow."""

    way_mm: float | None = means(
        "Longest way of the set point after an emergency stop, until it stands; `null` without any."
    )
    time_ms: float | None = means("Longest time from the arrival of a stop until the set point stands.")
    arm_way_mm: float | None = means(
        "Longest way of a simulated arm, which goes on behind its set point, from the arrival of a stop until the "
        "release; `null` without any."
    )
    bound_mm: float = means(
        "Way that the limits of patient.safety allow after a stop, v\u00b2/(2a) at the largest speed."
    )
    bound_ms: float = means("Time that they allow.")


LimitField = Literal["workspace_m", "speed_m_s", "acceleration_m_s2"]


class LimitedFigures(Section):
    """The set points in tracking that a limit kept off the active estimate; not by the limits after a break."""

    ticks: int = means("Ticks at which the set point in tracking was not the active estimate, by such a limit.")
    of_ticks: int = means("Ticks of the run.")
    off_mm: float | None = means("Longest distance between them at these ticks; `null` without any.")
    field: LimitField | None = means(
        "Field of patient.safety that was in the way at most of them; `null` without any, and where the arm, which "
        "begins at rest, had to catch up with a movement."
    )
    by_movement: bool = means(
        "Whether the true movement itself goes beyond that limit; else only the estimate does.", default=False
    )


class SafetyFigures(Section):
    """The set points of a hand, and its safety states."""

    time_s: dict[KindName, float] = means("Time in each safety state: tracking, resuming, hold, slow_stop, safe.")
    changes: int = means("Changes of the safety state, without the first one into tracking.")
    emergency_stops: int = means(
        "Emergency stops that the patient carried out, releases not counted; the same of each hand."
    )
    releases: int = means("Releases that it carried out; each ends one stop, or a latch.")
    releases_by_others: int = means(
        "Releases among them without the stop's token: they need not come from who had stopped. Stops "
        "without a secret are not counted."
    )
    released_by: list[str] = means(
        "Connections of which one sent each of these, by netem's audit log: address, and name by certificate.",
        default=[],
    )
    stop_requests_refused: int = means(
        "Requests to stop or to release that it refused and answered: wrong secret, no such stop in "
        "force, too many releases, ended before, not on this key."
    )
    stop_requests_flooded: int = means("Requests beyond 20 a second without an effect, which it counted only.")
    stops_unsigned: int | None = means(
        "Stops that nobody had signed, which were carried out; only where messages are signed.", default=None
    )
    shaped_ticks: int = means("Ticks at which the set point was not the active estimate, bit for bit.")
    limited: LimitedFigures | None = means(
        "Those of them in tracking that a limit of place, speed or acceleration explains.", default=None
    )
    rmse_3d_mm: float | None = means("Error of the set point, over the scored ticks that have both.")
    estimate_rmse_3d_mm: float | None = means("Error of the active estimate over the same ticks.")
    stop: StopFigures = means("Emergency stops.")
    largest_step_mm: float | None = means("Largest step of the set point from tick to tick.")
    estimate_largest_step_mm: float | None = means("The same of the active estimate.")


@dataclass(frozen=True)
class SetPoints:
    """The set points of one hand at the ticks of its track: (T, 3) in m, NaN for none, and states (T,), "" for none.

    ``differs`` (T,) marks the ticks at which the set point is not the active estimate, bit for bit.
    """

    position_m: Array
    mode: NDArray[np.str_]
    differs: NDArray[np.bool_]

    def stops(
        self, stopped_ns: Sequence[int], t_ns: NDArray[np.int64], arm_m: Array | None = None
    ) -> list[tuple[float, int, float | None]]:
        """Return the way in m and the time in ns of each emergency stop, from the request until the set point stands.

        ``stopped_ns`` are the instants of the requests, ``t_ns`` (T,) those of the ticks. A stop before the first set
        point, or one that a release ended before it stood, has none. Last is the way of an arm (T, 3) until the
        release, which goes on behind its set point; None without one.
        """
        found = []
        for at_ns in stopped_ns:
            first = int(np.searchsorted(t_ns, at_ns))  # the tick that stops
            standing = np.flatnonzero(self.mode[first:] == "safe")
            braking = self.mode[first : first + (standing[0] if standing.size else 0)]
            if not first or not standing.size or not np.isin(braking, ("slow_stop",)).all():
                continue
            last = first + int(standing[0])
            way_m = float(np.linalg.norm(self.position_m[last] - self.position_m[first - 1]))
            if not np.isfinite(way_m):
                continue
            arm_way_m = None
            if arm_m is not None:
                share = (at_ns - t_ns[first - 1]) / (t_ns[first] - t_ns[first - 1])
                begin_m = (1.0 - share) * arm_m[first - 1] + share * arm_m[first]
                until = last + int(np.argmin(np.append(self.mode[last:] == "safe", False)))
                ways_m = np.linalg.norm(arm_m[first:until] - begin_m, axis=1)
                arm_way_m = max((float(way) for way in ways_m if np.isfinite(way)), default=None)
            found.append((way_m, int(t_ns[last]) - at_ns, arm_way_m))
        return found


def set_points(logs: RunLogs, scenario: Scenario, track: HandTrack, hand: Hand) -> SetPoints | None:
    """Return the set points of a hand; None where the log holds none, as without `patient.safety`."""
    rows = logs.of_arm("patient", is_set_point, hand)
    if rows is None:
        return None
    rows = rows.at(np.argsort(rows.tick, kind="stable"))
    place, known = place_in(rows.tick, track.tick)
    placed, mode = at_ticks(track.tick, rows, "position_m"), np.where(known, rows.mode[place], "")
    estimate_m = track.estimates.get(scenario.active_estimator, np.full_like(placed, np.nan))
    same = (placed == estimate_m).all(axis=1) | ~np.isfinite(placed).all(axis=1)
    return SetPoints(placed, mode, ~same)


def safety_summary(
    logs: RunLogs, scenario: Scenario, tracks: Mapping[Hand, HandTrack], models: Sequence[ArmModel] = ()
) -> dict[Hand, SafetyFigures | None]:
    """Return the figures of each hand's set points, null without any. Oracle: test_safety, by hand.

    ``rmse_3d_mm`` of set point and estimate are over the same scored ticks; a step is from tick to tick. An arm that
    was stopped before its first set point has none, but figures: they count the stop, as they do every request.
    """
    stops = stop_books(logs)
    stopped_ns = [row["at_ns"] for row in logs.of("patient", STOPS) if row["stop"] and not row.get("refused")]
    found: dict[Hand, SafetyFigures | None] = {}
    for hand, track in tracks.items():
        driven = set_points(logs, scenario, track, hand)
        if driven is None and any(stops.values()):
            n = track.tick.size
            driven = SetPoints(np.full((n, 3), np.nan), np.full(n, ""), np.zeros(n, dtype=np.bool_))
        changes = [row for row in logs.of("patient", SAFETY) if row["hand"] == hand and row["cause"] != "first"]
        model = next((one for one in models if one.hand == hand), None)
        if driven is None:
            found[hand] = None
        else:
            found[hand] = _figures(scenario, track, driven, len(changes), stops, stopped_ns, model)
    return found


def stop_books(logs: RunLogs) -> dict[str, Any]:
    """Return the numbers of requests to stop or to release: carried out, refused, and only counted.

    What is carried out is all in the log. Of the others the log holds some, and the patient's counters all.
    """
    rows, counted = logs.of("patient", STOPS), counters_of(logs, "patient")
    done = [row for row in rows if not row.get("refused")]
    by_others = [row for row in done if row.get("by_stopper") is False]
    return {
        "emergency_stops": sum(row["stop"] for row in done),
        "releases": sum(not row["stop"] for row in done),
        "releases_by_others": len(by_others),
        "released_by": releasers(logs, {row.get("ends", 0) for row in by_others}),
        "stop_requests_refused": max(len(rows) - len(done), counted.get("stop_requests_refused", 0)),
        "stop_requests_flooded": counted.get("stop_requests_flooded", 0),
        "stops_unsigned": counted.get("stops_unsigned"),
    }


def _figures(
    scenario: Scenario, track: HandTrack, driven: SetPoints, n_changes: int, stops: Mapping[str, Any],
    stopped_ns: Sequence[int], model: ArmModel | None,
) -> SafetyFigures:  # fmt: skip
    estimate_m = track.estimates.get(scenario.active_estimator)
    movement = None if model is None else trained(scenario, model.arm_movement)
    limits = limits_of(scenario.patient.safety, scenario.rate_hz, movement)
    limited = None
    if estimate_m is not None and model is not None:
        limited = _limited(limits, driven, track, estimate_m, model.output_offset_m)
    both = track.scored & np.isfinite(driven.position_m).all(axis=1)
    if estimate_m is not None:
        both &= np.isfinite(estimate_m).all(axis=1)
    return SafetyFigures(
        time_s={mode: int((driven.mode == mode).sum()) / scenario.rate_hz for mode in get_args(SafetyMode)},
        changes=n_changes,
        **stops,
        shaped_ticks=int(driven.differs.sum()),
        limited=limited,
        rmse_3d_mm=_rmse_mm(driven.position_m - track.truth_m, both),
        estimate_rmse_3d_mm=None if estimate_m is None else _rmse_mm(estimate_m - track.truth_m, both),
        stop=_stop_figures(
            limits, scenario.rate_hz, driven.stops(stopped_ns, track.t_ns, track.estimates.get("plant"))
        ),
        largest_step_mm=_largest_step_mm(driven.position_m),
        estimate_largest_step_mm=None if estimate_m is None else _largest_step_mm(estimate_m),
    )


def _limited(
    limits: Limits, driven: SetPoints, track: HandTrack, estimate_m: Array, centre_m: Array
) -> LimitedFigures:
    """Return what the limits of tracking shaped. Within ``cautious_ms`` after a break only the workspace counts."""
    t_ns, truth_m = track.t_ns, track.truth_m
    off_m = np.linalg.norm(driven.position_m - estimate_m, axis=1)
    beyond = np.linalg.norm(estimate_m - centre_m, axis=1) > limits.workspace_m
    resumed_ns = np.maximum.accumulate(np.where(driven.mode == "resuming", t_ns, t_ns[:1] - limits.cautious_ns))
    which = driven.differs & np.isfinite(off_m) & (driven.mode == "tracking")
    which &= beyond | (t_ns - resumed_ns >= limits.cautious_ns)
    steps_m = np.linalg.norm(np.diff(driven.position_m, axis=0, prepend=driven.position_m[:1]), axis=1)
    fast = steps_m >= limits.usual.step * (1.0 - _ROUNDING)
    within = which & ~beyond & ~fast
    begins = within & _not_yet_met(driven)
    by_field: dict[LimitField | None, int] = {
        "workspace_m": int((which & beyond).sum()),
        "speed_m_s": int((which & ~beyond & fast).sum()),
        "acceleration_m_s2": int((within & ~begins).sum()),
        None: int(begins.sum()),
    }
    field = max(by_field, key=lambda name: by_field[name])
    reached_m, most_m = {
        None: (np.zeros((1, 3)), 0.0),
        "workspace_m": (truth_m - centre_m, limits.workspace_m),
        "speed_m_s": (np.diff(truth_m, axis=0), limits.usual.step),
        "acceleration_m_s2": (np.diff(truth_m, n=2, axis=0), limits.usual.change),
    }[field]
    return LimitedFigures(
        ticks=int(which.sum()),
        of_ticks=t_ns.size,
        off_mm=MM_PER_M * float(off_m[which].max()) if which.any() else None,
        field=field if which.any() else None,
        by_movement=bool(which.any() and (np.linalg.norm(reached_m, axis=1) > most_m).any()),
    )


def _not_yet_met(driven: SetPoints) -> NDArray[np.bool_]:
    """Return the ticks up to which the set point, which begins at rest, has not met a moving estimate."""
    after_first = int(np.argmax(driven.mode == "tracking")) + 1
    unmet = np.zeros(len(driven.differs), dtype=np.bool_)
    unmet[after_first:] = np.logical_and.accumulate(driven.differs[after_first:])
    return unmet


def _stop_figures(limits: Limits, rate_hz: int, stops: Sequence[tuple[float, int, float | None]]) -> StopFigures:
    """Return the longest way and time of the emergency stops, null without any, beside what the limits allow."""
    # a request waits for the next tick, and the arm counts as standing a tick after its last movement
    ticks = ceil(limits.usual.step / limits.usual.change) + 2
    return StopFigures(
        way_mm=max((MM_PER_M * way_m for way_m, *_ in stops), default=None),
        time_ms=max((time_ns / NS_PER_MS for _, time_ns, _ in stops), default=None),
        arm_way_mm=max((MM_PER_M * way_m for *_, way_m in stops if way_m is not None), default=None),
        bound_mm=MM_PER_M * limits.run_out_m,
        bound_ms=1000.0 * ticks / rate_hz,
    )


def _rmse_mm(error_m: Array, which: NDArray[np.bool_]) -> float | None:
    if not which.any():
        return None
    return MM_PER_M * sqrt(float(np.mean(np.sum(error_m[which] ** 2, axis=1))))


def _largest_step_mm(position_m: Array) -> float | None:
    steps_m = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    return MM_PER_M * float(np.nanmax(steps_m)) if np.isfinite(steps_m).any() else None


def limit_texts(safety: Mapping[Hand, SafetyFigures | None], unstable: Collection[Hand] = ()) -> list[str]:
    """Return warnings on hands whose set points a limit kept off the active estimate for more than a moment.

    Where a hand's loop of touch was ``unstable`` the limit is no fault: it held a swing.
    """
    return [
        f"in tracking the set points of the {hand} hand were kept off the active estimate at {number(found.ticks)} "
        f"of {number(found.of_ticks)} ticks, by up to {number(found.off_mm)} mm{_advice(found, hand in unstable)}"
        for hand, row in safety.items()
        if row is not None and (found := row.limited) and found.ticks > _MOST_LIMITED * found.of_ticks
    ]


_MAY: Final[Mapping[LimitField | None, str]] = {
    "workspace_m": "go that far", "speed_m_s": "move that fast", "acceleration_m_s2": "speed up and brake that hard",
}  # fmt: skip


def _advice(found: LimitedFigures, swings: bool) -> str:
    if swings:
        return ": its loop of touch swings, and the limit holds that"
    if found.field is None:
        return ": the arm began at rest, within a movement, and had to catch up with it"
    limit = f"patient.safety.{found.field}"
    if found.by_movement:
        may = _MAY[found.field]
        return f": the movement itself goes beyond {limit}, which did its work; raise it only if the arm may {may}"
    return f": the estimate, not the movement, jumps beyond {limit}, which did its work; see the estimator, and gaps"


def stop_texts(safety: Mapping[Hand, SafetyFigures | None]) -> list[str]:
    """Return sentences on emergency stops, on releases without the stop's token, and on what was refused.

    None of them makes a run invalid: its figures are what happened, and the arms stood where they were to stand.
    """
    hands = [row for row in safety.values() if row is not None]
    if not hands:
        return []
    books, safe_s = hands[0], max(row.time_s["safe"] for row in hands)
    n_stops, n_others = books.emergency_stops, books.releases_by_others
    n_refused, n_flooded = books.stop_requests_refused, books.stop_requests_flooded
    texts = []
    if n_stops:
        stopped = f"{_times('emergency stop', n_stops)} stopped the set points{_within(hands)}, which stood still "
        stopped += f"for {safe_s:.1f} s, outages included"
        texts.append(f"{stopped}: the errors count that time")
    if books.stops_unsigned:
        texts.append(
            f"{_times('stop', books.stops_unsigned)} had no valid signature: the arms stop for anybody (the audit "
            "log names who was connected)"
        )
    if n_others:
        releases = _times("release", n_others)
        by = f", by {' or '.join(books.released_by)}" if books.released_by else ""
        texts.append(f"{releases} came without the stop's token{by} (patient.safety.release says who may)")
    if n_refused:
        texts.append(f"the patient refused {_times('request', n_refused)} to stop or to release (reasons in the log)")
    if n_flooded:
        n_releases = books.releases
        n_all = n_stops + n_releases + n_refused + n_flooded
        done = f"{_times('stop', n_stops)} and {_times('release', n_releases)}"
        texts.append(
            f"a flood of {number(n_all)} requests to stop or to release: the patient carried out {done}, the others "
            "had no effect"
        )
    return texts


def _within(hands: Sequence[SafetyFigures]) -> str:
    """Return the longest way and time of the stops beside what is allowed; "" where none is known."""
    stops = [row.stop for row in hands if row.stop.way_mm is not None]
    if not stops:
        return ""
    way_mm, time_ms = (max(getattr(one, name) for one in stops) for name in ("way_mm", "time_ms"))
    allowed = f"{stops[0].bound_mm:.1f} mm, {stops[0].bound_ms:.0f} ms"
    arm_mm = max((one.arm_way_mm for one in stops if one.arm_way_mm is not None), default=None)
    arm = "" if arm_mm is None else f"; the arm behind them went on for {arm_mm:.1f} mm"
    return f" within {way_mm:.1f} mm and {time_ms:.0f} ms (allowed: {allowed}{arm})"


def _times(what: str, n: int) -> str:
    article = "an" if what[0] in "aeiou" else "a"
    return f"{article} {what}" if n == 1 else f"{number(n)} {what}s"
