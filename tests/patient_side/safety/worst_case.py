"""A search for the worst that estimates, ages and stops can make of a set point.

``python -m tests.patient_side.safety.worst_case [ROUNDS]`` prints, for each rate, the largest overshoot, stopping
distance and movement within 33 ms that it finds, beside their bounds. An adversary chooses a script of estimates; the
best scripts are changed at random, again and again.
"""

import random
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import degrees, dist
from typing import NamedTuple

from tis.common.scenario.safety import Safety
from tis.common.units import NS_PER_S
from tis.common.vector import Vector, minus, plus
from tis.patient_side.rotations import Quaternion, after_turn, turn_to
from tis.patient_side.safety.limits import limits_of
from tis.patient_side.safety.safety_state import SafetyFilter, SafetyState, Seen
from tis.patient_side.safety.set_point import STILL, Place, WristPose

_WINDOW_S = 0.033
_SETTLE_S = 0.25


class Act(NamedTuple):
    """One tick of a script: the estimate jumps, then moves on at a speed; or the data fail for this tick."""

    jump_m: Vector = STILL
    speed_m_s: Vector = STILL
    turn_rad: Vector = STILL
    gripper_rad: float = 0.0
    is_uncertain: bool = False
    stop: bool | None = None


class Found(NamedTuple):
    """What a script leads to; ``overshoot`` and ``stopped`` in m, rad and rad, beside their bounds; ``moved`` in m.

    ``overshoot`` is the distance from the segment between the place at the script's end and the estimate, which then
    stays: at most v^2 / (2 a) and a tick's step, where v is the speed that the set point carries then. ``stopped`` is
    the way after a stop at the script's end, ``moved`` the longest way within 33 ms.
    """

    overshoot: tuple[float, float, float]
    overshoot_bound: tuple[float, float, float]
    stopped: tuple[float, float, float]
    stopped_bound: tuple[float, float, float]
    moved: float


@dataclass
class _Arm:
    """A set point that is driven tick by tick at nominal instants."""

    safety: SafetyFilter
    rate_hz: int
    state: SafetyState = field(default_factory=SafetyState)
    k: int = 0
    estimate_m: Place = STILL
    turn: Quaternion = (0.0, 0.0, 0.0, 1.0)
    gripper_rad: float = 0.0

    def tick(self, act: Act) -> None:
        t_ns = self.k * NS_PER_S // self.rate_hz
        self.estimate_m = plus(self.estimate_m, plus(act.jump_m, _scaled(act.speed_m_s, 1.0 / self.rate_hz)))
        self.turn, self.gripper_rad = after_turn(self.turn, act.turn_rad), self.gripper_rad + act.gripper_rad
        if act.stop is not None:
            self.state = self.safety.stop(self.state, act.stop)
        wrist = WristPose(self.turn, self.gripper_rad)
        self.state = self.safety.step(
            self.state, t_ns, Seen(t_ns, self.estimate_m, 1.0 if act.is_uncertain else 0.001, wrist)
        )
        self.k += 1


def consequences(script: Sequence[Act], rate_hz: int, part: Safety | None = None) -> Found:
    """Return what follows from a script, with the limits of ``part``."""
    limits = limits_of(part or Safety(workspace_m=100.0), rate_hz)
    arm = _Arm(SafetyFilter(limits, STILL), rate_hz)
    n_window, places = max(1, round(_WINDOW_S * rate_hz)), [STILL]
    for act in (Act(), *script):
        arm.tick(act)
        assert arm.state.place is not None
        places.append(arm.state.place)
    moved = max((dist(a, b) for a, b in zip(places, places[n_window:], strict=False)), default=0.0)
    begun, n_settle = arm.state, int(_SETTLE_S * rate_hz) + 2
    speeds = _carried(begun)
    changes = (limits.usual.change, limits.wrist.usual.change, limits.wrist.usual.change)
    run_outs = [v * v / (2.0 * a) for v, a in zip(speeds, changes, strict=True)]
    bounds = [run_out + v for run_out, v in zip(run_outs, speeds, strict=True)]
    if begun.resumed_ns is not None and speeds[0] <= limits.slow.step:  # braked by the acceleration of resuming
        bounds[0] = speeds[0] ** 2 / (2.0 * limits.slow.change) + speeds[0]
    # The estimate stays, or the arm is stopped.
    still, stopped = _Arm(arm.safety, rate_hz, begun, arm.k, arm.estimate_m, arm.turn, arm.gripper_rad), arm
    beyond, ways = [(0.0, 0.0, 0.0)], [(0.0, 0.0, 0.0)]
    for i in range(n_settle):
        still.tick(Act())
        stopped.tick(Act(stop=True if i == 0 else None))
        beyond.append(_beyond(begun, still))
        ways.append(_between(begun, stopped.state))
    overshoot = _largest(beyond)
    return Found(
        overshoot,
        tuple(bounds),  # type: ignore[arg-type]
        _largest(ways),
        tuple(run_outs),  # type: ignore[arg-type]
        moved,
    )


def _carried(state: SafetyState) -> tuple[float, float, float]:
    assert state.wrist is not None
    motions = (state.motion, state.wrist.turning, state.wrist.gripping)
    return tuple(dist(motion.carried, STILL) for motion in motions)  # type: ignore[return-value]


def _beyond(begun: SafetyState, arm: _Arm) -> tuple[float, float, float]:
    """Return how far place, orientation and gripper are from the segments from where they began to the estimate."""
    assert begun.place is not None
    assert begun.wrist is not None
    assert arm.state.place is not None
    assert arm.state.wrist is not None
    here, there = begun.wrist.at, WristPose(arm.turn, arm.gripper_rad)
    place_m = _from_segment(minus(arm.state.place, begun.place), minus(arm.estimate_m, begun.place))
    turn_rad = _from_segment(
        turn_to(here.orientation, arm.state.wrist.at.orientation), turn_to(here.orientation, there.orientation)
    )
    low, high = sorted((here.gripper_rad, there.gripper_rad))
    at = arm.state.wrist.at.gripper_rad
    return place_m, turn_rad, max(low - at, at - high, 0.0)


def _between(begun: SafetyState, state: SafetyState) -> tuple[float, float, float]:
    assert begun.place is not None
    assert begun.wrist is not None
    assert state.place is not None
    assert state.wrist is not None
    one, other = begun.wrist.at, state.wrist.at
    turned = turn_to(one.orientation, other.orientation)
    return dist(begun.place, state.place), dist(turned, STILL), abs(one.gripper_rad - other.gripper_rad)


def _from_segment(point: Vector, end: Vector) -> float:
    """Return the distance of a point from the segment between the origin and ``end``."""
    square = sum(part * part for part in end)
    share = 0.0 if square == 0.0 else sum(a * b for a, b in zip(point, end, strict=True)) / square
    return dist(point, _scaled(end, min(max(share, 0.0), 1.0)))


def _largest(rows: Sequence[tuple[float, float, float]]) -> tuple[float, float, float]:
    return tuple(map(max, zip(*rows, strict=True)))


def _scaled(a: Vector, factor: float) -> Vector:
    return a[0] * factor, a[1] * factor, a[2] * factor


def a_script(rng: random.Random, rate_hz: int) -> list[Act]:
    """Return a script of up to a tenth of a second, and three ticks at least."""
    return [an_act(rng, rate_hz) for _ in range(rng.randint(1, rate_hz // 10 + 3))]


def an_act(rng: random.Random, rate_hz: int) -> Act:
    """Return a tick of a script: often a steady speed, sometimes a jump of any size, seldom data that fail."""
    kind = rng.random()
    if kind < 0.5:
        return Act(speed_m_s=_vector(rng, (0.1, 0.5, 2.0)))
    if kind < 0.7:
        return Act(jump_m=_vector(rng, (1e-4, 1e-3, 5e-3, 0.02, 0.1)))
    if kind < 0.8:
        return Act(turn_rad=_vector(rng, (0.01, 0.1, 1.0)), gripper_rad=rng.gauss(0, 0.3))
    if kind < 0.95:
        turn_rad = _scaled(_vector(rng, (2.0, 10.0, 40.0)), 1.0 / rate_hz)
        return Act(turn_rad=turn_rad, gripper_rad=rng.choice((2.0, 30.0)) * rng.gauss(0, 1) / rate_hz)
    return Act(is_uncertain=True) if kind < 0.98 else Act(stop=rng.random() < 0.4)


def _vector(rng: random.Random, sizes: Sequence[float]) -> Vector:
    size, is_straight = rng.choice(sizes), rng.random() < 0.5
    return size * rng.gauss(0, 1), 0.0 if is_straight else size * rng.gauss(0, 1), 0.0


def changed(script: Sequence[Act], rng: random.Random, rate_hz: int) -> list[Act]:
    """Return a script with a few ticks changed, repeated, added or left out."""
    found = list(script)
    for _ in range(rng.randint(1, 3)):
        i = rng.randrange(len(found))
        match rng.randrange(4):
            case 0:
                found[i] = an_act(rng, rate_hz)
            case 1:
                found[i:i] = [found[i]] * rng.randint(1, 5)
            case 2:
                found.insert(i, an_act(rng, rate_hz))
            case _ if len(found) > 1:
                del found[i]
    return found[: rate_hz // 5 + 5]


def search(rate_hz: int, n_rounds: int, worth: Callable[[Found], float], seed: int = 1) -> Found:
    """Return the consequences of the script that has most worth, of those that the search tries."""
    rng = random.Random(f"{rate_hz} {seed}")
    best = [(worth(found := consequences(script, rate_hz)), script, found)
            for script in (a_script(rng, rate_hz) for _ in range(8))]  # fmt: skip
    for _ in range(n_rounds):
        script = changed(rng.choice(best)[1], rng, rate_hz)
        found = consequences(script, rate_hz)
        best.append((worth(found), script, found))
        best.sort(key=lambda one: -one[0])
        del best[8:]
    return best[0][2]


def _way(found: Found, part: int) -> float:
    return found.stopped[part]


def overshot(found: Found, part: int) -> float:
    """Return by how much an overshoot exceeds its bound; ``part`` 0: place, 1: orientation, 2: gripper."""
    return found.overshoot[part] - found.overshoot_bound[part]


def run_on(found: Found, part: int) -> float:
    """Return by how much the way after a stop exceeds its bound."""
    return found.stopped[part] - found.stopped_bound[part]


def main() -> None:
    """Search at each rate, and print the worst beside the bounds."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    print("rate, Hz | overshoot beyond v^2/(2a) and a tick's step: mm, deg, deg (gripper) | longest way after a stop,"  # noqa: T201
          " mm (bound), deg, deg | in 33 ms, mm (bound)")  # fmt: skip
    for rate_hz in (30, 200, 1000, 5000):
        limits = limits_of(Safety(), rate_hz)
        excess = [max(overshot(search(rate_hz, n, partial(overshot, part=i)), i), 0.0) for i in range(3)]
        way = [search(rate_hz, n, partial(_way, part=i)).stopped[i] for i in range(3)]
        turn = limits.wrist.usual
        moved = search(rate_hz, n, lambda f: f.moved).moved
        bound_m = limits.usual.step / limits.usual.change * limits.usual.step / 2.0
        print(  # noqa: T201
            f"{rate_hz:5d} | {1e3 * excess[0]:.3f}, {degrees(excess[1]):.3f}, {degrees(excess[2]):.3f} |"
            f" {1e3 * way[0]:.2f} ({1e3 * bound_m:.2f}), {degrees(way[1]):.2f}, {degrees(way[2]):.2f}"
            f" ({degrees(turn.step**2 / (2 * turn.change)):.2f}) |"
            f" {1e3 * moved:.1f} ({1e3 * 2.0 * max(_WINDOW_S, 1 / rate_hz):.1f})"
        )


if __name__ == "__main__":
    main()
