"""Age of the freshest sample over time, and at the ticks of each possible tick mode."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from tis.common.channels import Arm, Hand, hand_channels
from tis.common.metrics.age_of_information import Arrivals, Ints, age_of_information, ages_when_used_ns, best_phase
from tis.common.metrics.percentiles import Summary, summarise
from tis.common.records import PHASES
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS, ms_to_ns
from tis.deploy.logs.coverage import FOREVER
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.note_columns import ticks

_CANDIDATES: Final = 64
_PERCENTILES: Final = (50, 95, 99)


def freshest_arrivals(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> list[Arrivals]:
    """Return the arrivals at the patient that brought a fresher sample of either stream, by hand."""
    messages = logs.messages("patient", "forward", session)
    found = []
    for hand, arm in arms.items():
        channels = hand_channels(hand, arm)
        keys = [channel.key(session) for channel in (channels.command, channels.arm)]
        ours = [messages[key] for key in keys if key in messages]
        nothing = np.empty(0, dtype=np.int64)
        recv_ns = np.concatenate([nothing, *(columns.log_ns for columns in ours)])
        found.append(Arrivals.of(recv_ns, np.concatenate([nothing, *(columns.sample_ns for columns in ours)])))
    return found


def age_of_information_ms(logs: RunLogs, arrivals: Sequence[Arrivals]) -> dict[str, Any]:
    """Return the summary's ``age_of_information_ms``: mean over time up to the last tick, and peaks, over all hands.

    None where the patient's log has a gap, as arrivals in it are unknown, or where a side was away and that time is
    left out. Oracle: a saw-tooth computed by hand,
    test_freshness.
    """
    covered = logs.coverage("patient")
    if logs.left_out or (covered is not None and any(until_ns != FOREVER for _, until_ns in covered.unknown)):
        arrivals = ()
    due_ns = ticks(logs).due_ns
    until_ns = int(due_ns[-1]) if len(due_ns) else 0
    ages = [age_of_information(one, until_ns) for one in arrivals]
    means = [age.mean_ns for age in ages if age.mean_ns is not None]
    peaks_ns = np.concatenate([np.empty(0, dtype=np.int64), *(age.peaks_ns for age in ages)])
    return {
        "mean": float(np.mean(means)) / NS_PER_MS if means else None,
        "peak": summarise(peaks_ns / NS_PER_MS, _PERCENTILES, ("mean", "max")),
    }


def tick_modes(logs: RunLogs, scenario: Scenario, arrivals: Sequence[Arrivals]) -> dict[str, Any]:
    """Return the summary's ``tick_modes``: the effect of each mode of ``patient.tick`` on this run's arrivals.

    ``age_when_used_ms`` is the age of a sample at the due instant of the first estimate that can use it, without
    computing time: in `free` at the scenario's phase, in `phase_locked` at the best constant phase in hindsight, in
    `on_arrival` at the arrival. ``saves_ms`` is the mean gain over `free`. ``shifts`` counts the phase changes in
    this run; ``line`` is the summary in words. Oracle: constant delays, test_freshness.
    """
    patient, rate_hz = scenario.patient, scenario.rate_hz
    phase_ns = ms_to_ns(patient.tick_phase_ms)
    clock = logs.clocks.model("patient")  # ticks are evenly spaced on this clock only
    by_patient = [Arrivals(*(clock.from_reference_ns(ns) for ns in one)) for one in arrivals]
    # the best phase in hindsight: by search over a grid of phases
    known = [one for one in by_patient if len(one.recv_ns)]
    best_ns = best_phase(known, rate_hz, phase_ns, _CANDIDATES).phase_ns if known else phase_ns
    ages = {
        "free": _all([ages_when_used_ns(one, rate_hz, phase_ns) for one in known]),
        "phase_locked": _all([ages_when_used_ns(one, rate_hz, best_ns) for one in known]),
        "on_arrival": _all([one.recv_ns - one.sample_ns for one in known]),
    }
    phases_ns = {"free": phase_ns, "phase_locked": best_ns}
    free_ns = float(ages["free"].mean()) if known else None
    entries = {}
    for mode, age_ns in ages.items():
        entry: dict[str, Any] = {"age_when_used_ms": _age_ms(age_ns)}
        entry["saves_ms"] = None if free_ns is None else (free_ns - float(age_ns.mean())) / NS_PER_MS
        if mode in phases_ns:
            entry["phase_ms"] = phases_ns[mode] / NS_PER_MS
        entries[mode] = entry
    shifts = len(logs.of("patient", PHASES))
    return {"mode": patient.tick, "shifts": shifts, **entries, "line": _line(patient.tick, shifts, entries)}


def _line(mode: str, shifts: int, entries: Mapping[str, Any]) -> str:
    free, locked, prompt = (entries[name] for name in ("free", "phase_locked", "on_arrival"))
    if free["saves_ms"] is None:
        return f"Ticks: {mode}; nothing arrived."
    this = f"{mode}, moved {shifts} times" if mode == "phase_locked" else mode
    return (
        f"Ticks: {this}. On these arrivals the mean age of a sample is {free['age_when_used_ms']['mean']:.1f} ms "
        f"when a free tick at {free['phase_ms']:.3g} ms uses it; the best fixed phase, {locked['phase_ms']:.3g} ms, "
        f"would save {max(locked['saves_ms'], 0.0):.1f} ms of that mean, "
        f"answering on arrival {prompt['saves_ms']:.1f} ms."
    )


def _all(parts: Sequence[Ints]) -> Ints:
    return np.concatenate([np.empty(0, dtype=np.int64), *parts])


def _age_ms(age_ns: Ints) -> Summary:
    return summarise(age_ns / NS_PER_MS, _PERCENTILES, ("mean", "max"))
