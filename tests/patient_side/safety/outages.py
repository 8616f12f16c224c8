"""Twins with an outage each, and jumps and stops: ``python -m tests.patient_side.safety.outages [N]``.

In every third twin forged samples jump by centimetres while data flow; in every other one an emergency stop comes two
seconds after the outage, and its release a second later.
"""

import json
import random
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import dist, exp, log
from typing import Any, cast

import numpy as np

from tests.deploy.run.attacker import Attacker, Forged
from tests.nodes import a_pose
from tis.common.channels import Side, release_key, stop_key
from tis.common.messages import encode
from tis.common.node import Node, Record
from tis.common.records import EstimateNote
from tis.common.runtime.loop import Recorder
from tis.common.runtime.recordings import load_recording
from tis.common.safety_records import SafetyNote
from tis.common.sources.trajectory import Recording
from tis.common.stop_messages import EmergencyStop
from tis.common.units import NS_PER_MS, NS_PER_S, sample_instant_ns
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, drive
from tis.patient_side.safety.set_point import Place

_AFTER_S = 6.0
# what no figure here looks at takes as long as all else: further estimators, and the orientation
_ONE_POSITION = (
    "source.hands=[left]",
    "estimators=[innovations_kf]",
    "active_estimator=innovations_kf",
    "patient.orientation={methods: [hold], active: hold}",
)


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


def watched(
    name: str,
    settings: tuple[str, ...],
    seed: int,
    duration_s: float | None,
    forged: Callable[[Recording], Sequence[Forged]] = lambda _: (),
) -> tuple[Watched, Any]:
    """Return what a twin of the scenario's first hand did, and its recording, with ``forged`` messages among its."""
    scenario = resolve(name, settings, seed=seed, duration_s=duration_s)
    recording = load_recording(scenario)
    nodes, _, _ = build_sides(scenario, recording=recording)
    everybody = cast("dict[Side, Node]", {**nodes, "attacker": Attacker(forged(recording))})
    seen, nothing = Watched(active=scenario.active_estimator), Nothing()
    recorders = {"surgeon": nothing, "netem": nothing, "patient": seen, "attacker": nothing}
    drive(scenario, everybody, cast("dict[Side, Recorder]", recorders))
    return seen, recording


@dataclass(frozen=True)
class Resumed:
    """What a twin did; lengths in mm.

    ``step_mm`` is the largest step of the set point from the outage on, ``any_step_mm`` that of the whole run,
    ``stop_mm`` the way after the emergency stop, None without one. The errors are those one second after resuming.
    """

    outage_s: float
    step_mm: float
    any_step_mm: float
    estimate_step_mm: float
    error_mm: float
    estimate_error_mm: float
    stop_mm: float | None


def one(number: int, name: str = "default") -> Resumed:
    """Run twin ``number``: an outage of both directions, of 0.5 to 30 s, log-uniform, that begins at 4 to 8 s."""
    draw = random.Random(number)
    outage_s = round(exp(draw.uniform(log(0.5), log(30))), 2)
    at_s = round(draw.uniform(4, 8), 2)
    entry = f"{{at_s: {at_s}, for_s: {outage_s}, direction: both, set: {{outage: true}}}}"
    settings = (f"network.timeline=[{entry}]", *_ONE_POSITION)
    stop_s = at_s + outage_s + 2.2 if number % 2 else None

    def forged(recording: Recording) -> list[Forged]:
        found = [] if stop_s is None else [_request(stop_s, True), _request(stop_s + 1.0, False)]
        return found + (_jumps(recording, 2.5, draw) if number % 3 == 2 else [])

    seen, recording = watched(name, settings, 1000 + number, at_s + outage_s + _AFTER_S, forged)
    # one second after resuming: the first tick then
    begin_ns = int(at_s * NS_PER_S)
    resumed_ns = next(note.t_ns for note in seen.notes if note.mode == "resuming" and note.t_ns > begin_ns)
    tick = min(k for k, t_ns in seen.t_ns.items() if t_ns >= resumed_ns + NS_PER_S)
    truth = recording.hands[0].follower.position_m[recording.start :]
    instants_s = np.arange(len(truth)) / recording.rate_hz
    at = tuple(float(np.interp(seen.t_ns[tick] / NS_PER_S, instants_s, truth[:, axis])) for axis in range(3))
    return Resumed(
        outage_s,
        max(seen.steps_mm(seen.driven, begin_ns)),
        max(seen.steps_mm(seen.driven, 0)),
        max(seen.steps_mm(seen.estimates, begin_ns)),
        1e3 * dist(seen.driven[tick], at),
        1e3 * dist(seen.estimates[tick], at),
        None if stop_s is None else _way_mm(seen, int(stop_s * NS_PER_S)),
    )


def _request(at_s: float, stop: bool) -> Forged:
    payload = encode(EmergencyStop(stop=stop, number=1 + (not stop), ends=0 if stop else 1))
    return Forged(int(at_s * NS_PER_S), stop_key("tis") if stop else release_key("tis"), 0, payload)


def _jumps(recording: Recording, at_s: float, draw: random.Random) -> list[Forged]:
    """Return five samples 2 to 10 cm off, each just before the true one, under its number."""
    (hand, *_), rate_hz, found = recording.hands, recording.rate_hz, list[Forged]()
    for k in range(int(at_s * rate_hz), int(at_s * rate_hz) + 5):
        off_m = draw.uniform(0.02, 0.1)
        for channel, track in ((hand.channels.command, hand.command), (hand.channels.arm, hand.follower)):
            x_m, y_m, z_m = track.position_m[recording.start + k].tolist()
            at_ns = sample_instant_ns(k, rate_hz)
            payload = encode(a_pose(x_m + off_m, y_m, z_m, sample_ns=at_ns))
            found.append(Forged(at_ns + NS_PER_MS, channel.key("tis"), k, payload))
    return found


def _way_mm(seen: Watched, stop_ns: int) -> float:
    """Return the way of the set point from the last tick before a stop to a second after it."""
    before = max(k for k, t_ns in seen.t_ns.items() if t_ns <= stop_ns)
    after = max(k for k, t_ns in seen.t_ns.items() if t_ns <= stop_ns + NS_PER_S)
    return 1e3 * dist(seen.driven[before], seen.driven[after])


def main() -> None:
    """Run as many twins as the first argument says, 100 by default, and print the worst."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    found = [one(i) for i in range(n)]
    stops = [r.stop_mm for r in found if r.stop_mm is not None]
    print(f"{n} twins, outages of {min(r.outage_s for r in found)} to {max(r.outage_s for r in found)} s")  # noqa: T201
    print(f"largest step from the outage on, mm: set point {max(r.step_mm for r in found):.3f},"  # noqa: T201
          f" estimate {max(r.estimate_step_mm for r in found):.1f};"
          f" of set points in the whole run: {max(r.any_step_mm for r in found):.1f}")  # fmt: skip
    print(f"{len(stops)} emergency stops, longest way {max(stops, default=0.0):.3f} mm")  # noqa: T201
    worst = max(r.error_mm / r.estimate_error_mm for r in found)
    print(f"error one second after resuming, set point over estimate: at most {worst:.3f}")  # noqa: T201


if __name__ == "__main__":
    main()
