"""Touch: whether the loop of force and hand is stable, what the hand feels of what the arm touches, and its price."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import inf, isfinite
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Arm as ArmName
from tis.common.channels import Hand, hand_channels, is_set_point, is_shown_force
from tis.common.coupling.stability import Arm, Limb, loop_limit
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.tracking import truth_at
from tis.common.records import CONTACTS, FRESH
from tis.common.scenario import Scenario
from tis.common.units import MM_PER_M, NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.section import Section, Statistics, means, statistics
from tis.deploy.report.subjects.logs import counters_of
from tis.deploy.report.subjects.stretches import network_edges_ns
from tis.deploy.report.subjects.tracking import at_ticks

Array = NDArray[np.float64]
Stability = Literal["stable", "unstable", "not_decidable"]

_WORST_FIRST: Final[Sequence[Stability]] = ("unstable", "stable", "not_decidable")
_WINDOW_S: Final = 0.25
_FEWEST: Final = 6
_GROWS: Final = 3.0
"""A swing that grows by this factor, or is so many times faster than what the hand intends, is instability."""
_LASTS: Final = 0.8
"""A swing of which so much is left in the last third lasts."""
_LIMITED: Final = 0.05
MJ_PER_J: Final = 1000.0


class TouchFigures(Section):
    """What a hand felt."""

    stability: Stability = means(
        "`stable`, `unstable` (the hand swings ever wider, or far faster than it intends), or `not_decidable` "
        "(too little contact, or a device that does not tell what its hand intends). An unstable run is a valid "
        "measurement."
    )
    stable: bool | None = means("The same for limits and comparisons; `null` for `not_decidable`.")
    stiffness_n_m: float | None = means(
        "Stiffness of the wall; `null` for tissue, and where an external arm tells the force."
    )
    limit_n_m: float | None = means(
        "Stiffness at which this loop becomes unstable in theory: with the mean round trip, its ticks, the operator "
        "and the servo, where the newest sample drives the arm; `null` where there is no theory."
    )
    limit_round_trip_ms: float | None = means(
        "That mean round trip, of the stretch of constant network that decides stability; `null` without a force.",
        default=None,
    )
    shown_over_true: float | None = means(
        "Stiffness that the hand feels over that of the wall, by least squares over the contact; `null` without any."
    )
    energy_mj: float = means(
        "Most energy that the coupling gave to the hand beyond what it had put in: the least sum of the hand's "
        "force times its movement, with the opposite sign. 0 where the coupling was passive."
    )
    force_error_n: Statistics = statistics(
        "Distance of the force shown to the force on the arm at the same instant, delay and deadband included.",
        "rms p50 p95 max",
    )
    force_beyond_n: Statistics = statistics(
        "What of it exceeds the deadband's share of the force shown: delay, loss, limits and fading.",
        "rms p50 p95 max",
    )
    force_delay_ms: Statistics = statistics("From the tick at which a force acts to its arrival at the surgeon.")
    round_trip_ms: Statistics = statistics(
        "From the sample of the newest command behind a force to the tick at which the hand feels it."
    )
    drift_mm: float | None = means(
        "Mean distance of the set point from the place of the hand that it follows, over the last second."
    )
    force_packets: dict[str, int] = means("Forces by what became of them: `sent`, `suppressed` by the deadband.")
    motion_packets: dict[str, int] = means("Samples of the hand, likewise.")
    peak_force_n: float = means("Largest force on what the arm touched.")


def shown_forces(logs: RunLogs, hand: Hand) -> Frame | None:
    """Return the forces shown to a hand by tick, None without any."""
    rows = logs.of_arm("surgeon", is_shown_force, hand)
    return None if rows is None else rows.first_of_each("tick")


def energy_j(shown: Frame) -> Array:
    """Return E (N,) at the ticks: the sum of the hand's force times its movement, into the coupling, in J."""
    work = -(shown.force_n[:-1] * np.diff(shown.position_m, axis=0)).sum(axis=1)
    return np.concatenate([[0.0], np.cumsum(work)])


def felt_extremes(logs: RunLogs, hands: Mapping[Hand, Any]) -> tuple[Array, Array]:
    """Return the force (N,) on what the arms touch, in N, and the energy (M,) given to the hands so far, in mJ."""
    forces, energies = [np.empty(0)], [np.empty(0)]
    for hand in hands:
        contacts, shown = logs.of_hand("patient", CONTACTS, hand), shown_forces(logs, hand)
        if len(contacts):
            forces.append(np.linalg.norm(contacts.force_n, axis=1))
        if shown is not None:
            energies.append(MJ_PER_J * np.maximum(-energy_j(shown), 0.0))
    return np.concatenate(forces), np.concatenate(energies)


def touch_summary(logs: RunLogs, scenario: Scenario, arms: Mapping[Hand, ArmName]) -> dict[str, Any]:
    """Return the figures of each hand under ``touch``; nothing for a run without touch. Oracle: test_touch."""
    if scenario.touch is None:
        return {}
    found = {hand: _figures(logs, scenario, hand, arm) for hand, arm in arms.items()}
    return {"touch": {hand: one for hand, one in found.items() if one is not None}}


def _figures(logs: RunLogs, scenario: Scenario, hand: Hand, arm: ArmName) -> TouchFigures | None:
    part, shown = scenario.touch, shown_forces(logs, hand)
    contacts = logs.of_hand("patient", CONTACTS, hand).first_of_each("tick")
    if part is None or shown is None or not len(contacts):
        return None
    is_ours = scenario.patient.plant.kind != "external"  # what such an arm touches is not known here
    wall = part.environment if part.environment.kind == "wall" and is_ours else None
    looped, decides = judged(shown, network_edges_ns(logs, scenario), scenario.rate_hz)
    trip_ns, its_trip_ns = (trip[np.isfinite(trip)] for trip in (
        shown.sample_ns - shown.command_ns, decides.sample_ns - decides.command_ns,
    ))  # fmt: skip
    trip_s = float(its_trip_ns.mean()) / NS_PER_S if len(its_trip_ns) else None
    error_n = np.linalg.norm(shown.force_n - truth_at(shown.sample_ns, contacts.t_ns, contacts.force_n), axis=1)
    beyond_n = np.maximum(error_n - part.deadband.force * np.linalg.norm(shown.force_n, axis=1), 0.0)
    force = logs.messages("surgeon", "feedback", scenario.session).get(
        hand_channels(hand, arm).force.key(scenario.session)
    )
    late_ns = np.empty(0) if force is None else force.log_ns - force.sample_ns
    counted = {**counters_of(logs, "surgeon"), **counters_of(logs, "patient")}
    return TouchFigures(
        stability=looped,
        stable=None if looped == "not_decidable" else looped == "stable",
        stiffness_n_m=None if wall is None else wall.stiffness_n_m,
        limit_n_m=None if trip_s is None else predicted_limit(scenario, trip_s),
        limit_round_trip_ms=None if trip_s is None else 1000.0 * trip_s,
        shown_over_true=None if wall is None else _shown_over(shown, wall.stiffness_n_m, _normal(part.environment)),
        energy_mj=MJ_PER_J * max(0.0, -float(energy_j(shown).min())),
        force_error_n=_errors(error_n),
        force_beyond_n=_errors(beyond_n),
        force_delay_ms=summarise(late_ns / NS_PER_MS),
        round_trip_ms=summarise(trip_ns / NS_PER_MS),
        drift_mm=_drift_mm(logs, shown, hand),
        force_packets={name: counted.get(f"force_{name}.{hand}", 0) for name in ("sent", "suppressed")},
        motion_packets={name: counted.get(f"motion_{name}.{hand}", 0) for name in ("sent", "suppressed")},
        peak_force_n=float(np.linalg.norm(contacts.force_n, axis=1).max()),
    )


def _errors(error_n: Array) -> dict[str, float | None]:
    known = error_n[np.isfinite(error_n)]
    rms_n = float(np.sqrt(np.mean(known**2))) if len(known) else None
    return {"rms": rms_n, **summarise(known, (50, 95), ("max",))}


def predicted_limit(scenario: Scenario, delay_s: float) -> float | None:
    """Return the stiffness (N/m) at which theory expects instability; None for what it does not cover."""
    loop = loop_of(scenario)
    found = inf if loop is None else loop_limit(*loop, delay_s, 1.0 / scenario.rate_hz)
    return found if isfinite(found) else None


def loop_of(scenario: Scenario) -> tuple[Limb, Arm] | None:
    """Return the hand and the arm of a loop that theory covers; None for another one."""
    part, plant = scenario.touch, scenario.patient.plant
    if part is None or part.coupling != "position_force" or plant.kind != "servo" or not scenario.simulates_hand:
        return None
    return Limb(*part.operator.with_device), Arm(plant.bandwidth_hz, plant.damping, plant.moved_mass_kg)


def judged(shown: Frame, changed_ns: Sequence[int] | Array, rate_hz: int) -> tuple[Stability, Frame]:
    """Return the verdict on a loop, and the stretch that decides it.

    Between the changes of its network that were made while it ran each stretch is judged; the worst one decides.
    Oracle: stretches that swing and do not, test_touch.
    """
    edges = [0, *np.unique(np.searchsorted(shown.sample_ns, changed_ns)).tolist(), len(shown)]
    parts = [shown.at(slice(begin, end)) for begin, end in pairwise(edges) if begin < end] or [shown]
    return min(((stability(part, rate_hz), part) for part in parts), key=lambda one: _WORST_FIRST.index(one[0]))


def stability(shown: Frame, rate_hz: int) -> Stability:
    """Return whether a hand swings ever wider under the forces that it feels, or stands them.

    The speed at which it is off what it intends is looked at in windows of 0.25 s from the first contact on: the loop
    is unstable where the speed of the last third is three times that of the first and exceeds what the hand intends,
    where it lasts and is three times what the hand intends, or where the force is cut by its limit for long. Oracle:
    swings of known growth, test_touch.

    A hand that is never off what it intends is that of a device, which tells no intention: nothing is decided.
    """
    felt = np.linalg.norm(shown.force_n, axis=1) > 0.0
    if not felt.any() or np.array_equal(shown.position_m, shown.intended_m):
        return "not_decidable"
    first, n = int(np.argmax(felt)), max(round(_WINDOW_S * rate_hz), 2)
    if np.mean((shown.limited == "force")[first:][felt[first:]]) > _LIMITED:
        return "unstable"
    off, meant = (np.diff(each[first:], axis=0) * rate_hz for each in (
        shown.position_m - shown.intended_m, shown.intended_m,
    ))  # fmt: skip
    n_windows = len(off) // n
    touched = felt[first : first + n_windows * n].reshape(n_windows, n).any(axis=1)
    if np.count_nonzero(touched) < _FEWEST:
        return "not_decidable"
    off_m_s, meant_m_s = (
        np.sqrt(np.mean(np.sum(each[: n_windows * n].reshape(n_windows, n, 3) ** 2, axis=2), axis=1))[touched]
        for each in (off, meant)
    )
    third = len(off_m_s) // 3
    early, late = float(np.median(off_m_s[:third])), float(np.median(off_m_s[-third:]))
    usual = float(np.sqrt(np.mean(meant_m_s**2)))
    if late > max(_GROWS * early, usual) or late > max(_LASTS * early, _GROWS * usual):
        return "unstable"
    return "stable" if late <= max(_LASTS * early, usual) else "not_decidable"


def _normal(environment: Any) -> Array:
    normal = np.array(environment.normal)
    return np.asarray(normal / np.linalg.norm(normal))


def _shown_over(shown: Frame, stiffness_n_m: float, normal: Array) -> float | None:
    """Return the slope of the force over the depth of the hand, over the wall's stiffness."""
    force, place = shown.force_n @ normal, -(shown.position_m @ normal)
    felt = np.abs(force) > 0.0
    spread = np.var(place[felt]) if np.count_nonzero(felt) > 1 else 0.0
    if spread == 0.0:
        return None
    return float(np.cov(place[felt], force[felt], bias=True)[0, 1] / spread / stiffness_n_m)


def _drift_mm(logs: RunLogs, shown: Frame, hand: Hand) -> float | None:
    """Return how far set points are off the hand's place at the sample that they follow, in the last second."""
    rows = logs.of_arm("patient", is_set_point, hand)
    fresh = logs.of_hand("patient", FRESH, hand)
    fresh = fresh.at(fresh.sample_ns >= shown.sample_ns[-1] - NS_PER_S)
    if rows is None or not len(fresh):
        return None
    rows = rows.at(np.argsort(rows.tick, kind="stable"))
    off = at_ticks(fresh.tick, rows, "position_m") - truth_at(fresh.sample_ns, shown.sample_ns, shown.position_m)
    off = off[np.isfinite(off).all(axis=1)]
    return MM_PER_M * float(np.linalg.norm(off.mean(axis=0))) if len(off) else None
