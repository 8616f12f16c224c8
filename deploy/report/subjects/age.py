"""Age of the freshest sample: at the ticks, over time, and at the ticks of each possible tick mode."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Arm, Hand, hand_channels
from tis.common.metrics.age_of_information import Arrivals, age_of_information, ages_when_used_ns, best_phase
from tis.common.metrics.latency import Instants
from tis.common.metrics.percentiles import summarise
from tis.common.records import FRESH, PHASES
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS, ms_to_ns
from tis.deploy.logs.coverage import FOREVER, WRITTEN_WITHIN_NS, lies_in
from tis.deploy.logs.read.columns import joined
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import begun_ticks, place_in
from tis.deploy.present.numbers import counted, heads, number
from tis.deploy.present.table import Table
from tis.deploy.report.section import MEAN_LATE, Section, Statistics, means, statistics


class AgeOfInformation(Section):
    """The age of information, in ms."""

    mean: float | None = means("Mean age of information over time.")
    peak: Statistics = statistics("Peaks of the age of information, just before a fresher sample arrives.", MEAN_LATE)


class TickMode(Section):
    """What a mode of ``patient.tick`` would have done on this run's arrivals."""

    age_when_used_ms: Statistics = statistics("Age of a sample when it is first used.", MEAN_LATE)
    saves_ms: float | None = means("Mean age saved against free ticks.")
    phase_ms: float | None = means(
        "Phase of the ticks, of `phase_locked` the best fixed one in hindsight.", default=None
    )


TICK_MODES: Final = ("free", "phase_locked", "on_arrival")
"""The modes in their order."""


class TickModes(Section):
    """The modes of ``patient.tick`` beside each other."""

    mode: str = means("Tick mode of this run (`patient.tick`).")
    shifts: int = means("How often the phase of the ticks was moved.")
    free: TickMode = means("Free ticks.")
    phase_locked: TickMode = means("Ticks at the best fixed phase.")
    on_arrival: TickMode = means("An answer at each arrival.")
    line: str = means("The comparison of the modes, in words.")


def ages_ns(logs: RunLogs) -> Instants:
    """Return the age at every tick, hand by hand: its instant minus that of the freshest sample of either stream.

    Ticks without a new arrival count too, so an outage shows here and not in the end-to-end latency. Missed ticks and
    those before the first sample have no age. Oracle: an outage of known length, tests/deploy/run/test_twin.
    """
    hands: list[Hand] = np.unique(logs.of("patient", FRESH).column("hand")).tolist()
    return joined(ages_of_hand(logs, hand)[1] for hand in hands)


def ages_of_hand(logs: RunLogs, hand: Hand) -> tuple[Instants, Instants]:
    """Return the instants (N,) of the ticks at which one hand has an age, and the ages (N,), both in ns."""
    begun, fresh = begun_ticks(logs), logs.of_hand("patient", FRESH, hand)
    order = np.argsort(fresh.tick, kind="stable")
    tick, sample_ns = fresh.tick[order], fresh.sample_ns[order]
    # notes exist only for ticks with a new freshest sample; the others keep the one before
    newest = np.searchsorted(tick, begun.tick, side="right") - 1
    known = (newest >= 0) & ~near_gap_of_patient(logs, begun.due_ns)
    return begun.due_ns[known], begun.due_ns[known] - sample_ns[newest[known]]


def ages_at_ms(logs: RunLogs, hand: Hand, t_ns: Instants) -> NDArray[np.float64]:
    """Return one hand's ages (T,) in ms at the tick instants ``t_ns`` (T,), NaN for none."""
    at_ns, age_ns = ages_of_hand(logs, hand)
    place, known = place_in(at_ns, t_ns)
    age_ms = np.full(len(t_ns), np.nan)
    age_ms[known] = age_ns[place[known]] / NS_PER_MS
    return age_ms


def near_gap_of_patient(logs: RunLogs, due_ns: Instants) -> NDArray[np.bool_]:
    """Mark the ticks (T,) near a gap of the patient's log: the note of their freshest sample may be lost in it."""
    covered = logs.coverage("patient")
    gaps = logs.left_out if covered is None else (*covered.unknown, *covered.away, *logs.left_out)
    return lies_in(due_ns, gaps, WRITTEN_WITHIN_NS, WRITTEN_WITHIN_NS)


_CANDIDATES: Final = 64


def freshest_arrivals(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> list[Arrivals]:
    """Return the arrivals at the patient that brought a fresher sample of either stream, by hand."""
    messages = logs.messages("patient", "forward", session)
    found = []
    for hand, arm in arms.items():
        channels = hand_channels(hand, arm)
        keys = [channel.key(session) for channel in (channels.command, channels.arm)]
        ours = [messages[key] for key in keys if key in messages]
        recv_ns, sample_ns = (joined(getattr(one, name) for one in ours) for name in ("log_ns", "sample_ns"))
        found.append(Arrivals.of(recv_ns, sample_ns))
    return found


def age_of_information_ms(logs: RunLogs, arrivals: Sequence[Arrivals]) -> AgeOfInformation:
    """Return the summary's ``age_of_information_ms``: mean over time up to the last tick, and peaks, over all hands.

    None where the patient's log has a gap, as arrivals in it are unknown, or where a side was away and that time is
    left out. Oracle: a saw-tooth computed by hand, test_age.
    """
    covered = logs.coverage("patient")
    if logs.left_out or (covered is not None and any(until_ns != FOREVER for _, until_ns in covered.unknown)):
        arrivals = ()
    due_ns = begun_ticks(logs).due_ns
    until_ns = int(due_ns[-1]) if len(due_ns) else 0
    ages = [age_of_information(one, until_ns) for one in arrivals]
    means = [age.mean_ns for age in ages if age.mean_ns is not None]
    peaks_ns = joined(age.peaks_ns for age in ages)
    return AgeOfInformation(
        mean=float(np.mean(means)) / NS_PER_MS if means else None,
        peak=summarise(peaks_ns / NS_PER_MS, also=("mean", "max")),
    )


def tick_modes(logs: RunLogs, scenario: Scenario, arrivals: Sequence[Arrivals]) -> TickModes:
    """Return the summary's ``tick_modes``: the effect of each mode of ``patient.tick`` on this run's arrivals.

    ``age_when_used_ms`` is the age of a sample at the due instant of the first estimate that can use it, without
    computing time: in `free` at the scenario's phase, in `phase_locked` at the best constant phase in hindsight, in
    `on_arrival` at the arrival. ``saves_ms`` is the mean gain over `free`. ``shifts`` counts the phase changes in
    this run; ``line`` is the summary in words. Oracle: constant delays, test_age.
    """
    patient, rate_hz = scenario.patient, scenario.rate_hz
    phase_ns = ms_to_ns(patient.tick_phase_ms)
    clock = logs.clocks.model("patient")  # ticks are evenly spaced on this clock only
    by_patient = [Arrivals(*(clock.from_reference_ns(ns) for ns in one)) for one in arrivals]
    # the best phase in hindsight: by search over a grid of phases
    known = [one for one in by_patient if len(one.recv_ns)]
    best_ns = best_phase(known, rate_hz, phase_ns, _CANDIDATES).phase_ns if known else phase_ns
    ages = {
        "free": joined(ages_when_used_ns(one, rate_hz, phase_ns) for one in known),
        "phase_locked": joined(ages_when_used_ns(one, rate_hz, best_ns) for one in known),
        "on_arrival": joined(one.recv_ns - one.sample_ns for one in known),
    }
    phases_ns = {"free": phase_ns, "phase_locked": best_ns}
    free_ns = float(ages["free"].mean()) if known else None
    entries = {
        mode: TickMode(
            age_when_used_ms=summarise(age_ns / NS_PER_MS, also=("mean", "max")),
            saves_ms=None if free_ns is None else (free_ns - float(age_ns.mean())) / NS_PER_MS,
            **({"phase_ms": phases_ns[mode] / NS_PER_MS} if mode in phases_ns else {}),
        )
        for mode, age_ns in ages.items()
    }
    shifts = len(logs.of("patient", PHASES))
    return TickModes(mode=patient.tick, shifts=shifts, **entries, line=_line(patient.tick, shifts, entries))


def _line(mode: str, shifts: int, entries: Mapping[str, TickMode]) -> str:
    free, locked, prompt = (entries[name] for name in ("free", "phase_locked", "on_arrival"))
    if free.saves_ms is None:
        return f"Ticks: {mode}; nothing arrived."
    this = f"{mode}, moved {counted(shifts, 'time')}" if mode == "phase_locked" else mode
    return (
        f"Ticks: {this}. On these arrivals the mean age of a sample is {free.age_when_used_ms['mean']:.1f} ms "
        f"when a free tick at {free.phase_ms:.3g} ms uses it; the best fixed phase, {locked.phase_ms:.3g} ms, "
        f"would save {max(locked.saves_ms or 0.0, 0.0):.1f} ms of that mean, "
        f"answering on arrival {prompt.saves_ms:.1f} ms."
    )


def tick_mode_table(modes: TickModes) -> Table:
    """Return the age of samples under each mode of the patient's tick; the run's own mode is marked."""
    rows = [
        (mode, *(modes[mode].age_when_used_ms[name] for name in ("mean", "p50", "p99")), modes[mode].saves_ms)
        for mode in TICK_MODES
    ]
    caption = "Age of a sample when a tick first uses it, ms, and what another mode of the tick would save"
    return Table(caption, ("patient.tick", *heads(("mean", "p50", "p99")), "saves, mean"), rows, marked=modes.mode)


def age_text(age: AgeOfInformation) -> str:
    """Return the age of information in words; "" without any."""
    if age.mean is None:
        return ""
    return (
        f"Age of information, how old the newest sample is at any instant: mean {number(age.mean)} ms; just before "
        f"the next one comes (peak): mean {number(age.peak['mean'])} ms."
    )
