"""Twins with one outage each, and what their set points did: ``python -m tests.patient_side.safety.outages [N]``."""

import json
import random
import sys
from dataclasses import dataclass, field
from itertools import pairwise
from math import dist, exp, log
from typing import Any

import numpy as np

from common.node import Record
from common.records import EstimateNote
from common.runtime.recordings import load_recording
from common.safety_records import SafetyNote
from common.units import NS_PER_S
from deploy.run.resolve import resolve
from deploy.run.twin import build_sides, drive
from patient_side.safety.set_point import Place

_AFTER_S = 6.0


@dataclass
class Watched:
    """The records of one hand that count here, as they are logged."""

    estimates: dict[int, Place] = field(default_factory=dict)
    driven: dict[int, Place] = field(default_factory=dict)
    t_ns: dict[int, int] = field(default_factory=dict)
    notes: list[SafetyNote] = field(default_factory=list)
    active: str = ""

    def record(self, record: Record) -> None:
        if isinstance(record.data, SafetyNote):
            self.notes.append(record.data)
        elif isinstance(record.data, EstimateNote) and record.data.estimator == self.active:
            where = record.data.position_m
            self.t_ns[record.data.tick] = record.data.t_ns
            if where is not None:
                self.estimates[record.data.tick] = (where.x, where.y, where.z)
        elif record.topic.endswith("/servo_cp"):
            row: dict[str, Any] = json.loads(record.data)  # type: ignore[arg-type]
            place = row["position_m"]
            self.driven[row["tick"]] = (place["x"], place["y"], place["z"])

    def steps_mm(self, places: dict[int, Place], from_ns: int) -> list[float]:
        """Return the steps from tick to tick that end at or after ``from_ns``."""
        return [
            1e3 * dist(places[a], places[b])
            for a, b in pairwise(sorted(places))
            if b == a + 1 and self.t_ns[b] >= from_ns
        ]


class Nothing:
    """A log that keeps nothing."""

    def record(self, record: Record) -> None:
        """Drop it."""


def watched(name: str, settings: tuple[str, ...], seed: int, duration_s: float | None) -> tuple[Watched, Any]:
    """Return what a twin of the scenario's first hand did, and its recording."""
    scenario = resolve(name, settings, seed=seed, duration_s=duration_s)
    recording = load_recording(scenario)
    nodes, _, _ = build_sides(scenario, recording=recording)
    seen = Watched(active=scenario.active_estimator)
    drive(scenario, nodes, {"surgeon": Nothing(), "netem": Nothing(), "patient": seen})
    return seen, recording


@dataclass(frozen=True)
class Resumed:
    """Largest steps after an outage's beginning, in mm, and the errors one second after resuming."""

    outage_s: float
    step_mm: float
    estimate_step_mm: float
    error_mm: float
    estimate_error_mm: float


def one(number: int, name: str = "default") -> Resumed:
    """Run twin ``number``: an outage of both directions, of 0.5 to 30 s, log-uniform, that begins at 4 to 8 s."""
    draw = random.Random(number)
    outage_s = round(exp(draw.uniform(log(0.5), log(30))), 2)
    at_s = round(draw.uniform(4, 8), 2)
    entry = f"{{at_s: {at_s}, for_s: {outage_s}, direction: both, set: {{outage: true}}}}"
    settings = (f"network.timeline=[{entry}]", "source.hands=[left]")
    seen, recording = watched(name, settings, 1000 + number, at_s + outage_s + _AFTER_S)
    # one second after resuming: the first tick then
    resumed_ns = next(note.t_ns for note in seen.notes if note.mode == "resuming")
    tick = min(k for k, t_ns in seen.t_ns.items() if t_ns >= resumed_ns + NS_PER_S)
    truth = recording.hands[0].follower.position_m[recording.start :]
    instants_s = np.arange(len(truth)) / recording.rate_hz
    at = tuple(float(np.interp(seen.t_ns[tick] / NS_PER_S, instants_s, truth[:, axis])) for axis in range(3))
    begin_ns = int(at_s * NS_PER_S)
    return Resumed(
        outage_s,
        max(seen.steps_mm(seen.driven, begin_ns)),
        max(seen.steps_mm(seen.estimates, begin_ns)),
        1e3 * dist(seen.driven[tick], at),
        1e3 * dist(seen.estimates[tick], at),
    )


def main() -> None:
    """Run as many twins as the first argument says, 100 by default, and print the worst."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    found = [one(i) for i in range(n)]
    print(f"{n} twins, outages of {min(r.outage_s for r in found)} to {max(r.outage_s for r in found)} s")  # noqa: T201
    print(f"largest step, mm: set point {max(r.step_mm for r in found):.3f},"  # noqa: T201
          f" estimate {max(r.estimate_step_mm for r in found):.1f}")  # fmt: skip
    worst = max(r.error_mm / r.estimate_error_mm for r in found)
    print(f"error one second after resuming, set point over estimate: at most {worst:.3f}")  # noqa: T201


if __name__ == "__main__":
    main()
