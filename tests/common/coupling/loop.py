"""A hand and an arm coupled through two delay lines, tick by tick: the kernels without nodes, network or logs."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tis.common.coupling.stability import Limb
from tis.common.coupling.tdpa import PassiveArm, PassiveHand, ReceivedEnergy
from tis.common.coupling.wave import WaveArm, WaveHand, WaveQueue
from tis.common.vector import ZERO, Vector, minus, plus, scaled
from tis.patient_side.plant.environment import Environment, Wall
from tis.patient_side.plant.protocol import Reference
from tis.patient_side.plant.touching_servo import TouchingServo
from tis.surgeon_side.operator import Operator

Array = NDArray[np.float64]

PERIOD_NS = 1_000_000
PERIOD_S = 1e-3


def a_servo(stiffness_n_m: float, arm_stiffness_n_m: float = 400.0, distance_m: float = 0.0) -> TouchingServo:
    """The prototype's arm: 0.3 kg, 400 N/m, 9 N s/m, before a wall that faces +x."""
    natural = (arm_stiffness_n_m / 0.3) ** 0.5
    wall = Environment(Wall(stiffness_n_m, 0.0), (1.0, 0.0, 0.0), None, distance_m)
    return TouchingServo(natural / (2 * np.pi), 9.0 / (2 * 0.3 * natural), 0.3, wall, lambda _: np.zeros(3))


@dataclass
class Line:
    """A delay line of whole ticks, with loss, jitter and duplicates by a seeded generator."""

    ticks: int
    p_loss: float = 0.0
    jitter: int = 0
    p_twice: float = 0.0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))
    seen: set[int] = field(default_factory=set)
    due: defaultdict[int, list[tuple[int, Any]]] = field(default_factory=lambda: defaultdict(list))

    def send(self, k: int, message: Any) -> None:
        for _ in range(1 + (self.rng.random() < self.p_twice)):
            if self.rng.random() >= self.p_loss:
                extra = int(self.rng.integers(0, self.jitter + 1)) if self.jitter else 0
                self.due[k + self.ticks + extra].append((k, message))

    def arrived(self, k: int) -> list[tuple[int, Any]]:
        """Messages of tick k that are no duplicates."""
        found = [one for one in self.due.pop(k, []) if one[0] not in self.seen]
        self.seen.update(number for number, _ in found)
        return found


@dataclass
class Loop:
    """Runs a coupling; ``intended_m`` gives the hand's intention at tick k, along x, negative into the wall."""

    kind: str
    servo: TouchingServo
    limb: Limb
    forward: Line
    back: Line
    impedance_ns_m: float = 20.0

    def run(self, n: int, intended_m: Callable[[int], float]) -> tuple[Array, Array]:
        """Return hand's place and its force on the coupling (n,), along x."""
        hand = Operator(self.limb, PERIOD_S)
        most = self.limb.mass_kg / PERIOD_S
        energies = [ReceivedEnergy(1e9, PERIOD_S) for _ in range(2)]
        k_arm = self.servo.stiffness_n_m
        wave_hand = WaveHand(self.impedance_ns_m, PERIOD_S, most)
        wave_arm = WaveArm(self.impedance_ns_m, PERIOD_S, k_arm)
        tdpa_hand, tdpa_arm = PassiveHand(PERIOD_S, most, energies[0]), PassiveArm(k_arm, energies[1])
        to_arm, to_hand = WaveQueue(), WaveQueue()
        state, target, wanted, shown, force = self.servo.initial(), ZERO, ZERO, ZERO, ZERO
        newest = {"forward": -1, "back": -1}
        places, forces = np.empty(n), np.empty(n)
        before: Vector = (intended_m(0), 0.0, 0.0)
        start = before
        target = wanted = start
        for k in range(n):
            here = plus((intended_m(k), 0.0, 0.0), hand.off_m)
            moved = minus(here, before)
            before = here
            # the hand's message, then its force
            if self.kind == "wave":
                self.forward.send(k, (here, wave_hand.moved(force, moved)))
            else:
                self.forward.send(k, (here, tdpa_hand.moved(force, moved)))
            for number, (shown_n, extra) in self.back.arrived(k):
                if self.kind == "wave":
                    to_hand.put(extra)
                if number > newest["back"]:
                    newest["back"], shown = number, shown_n
                    if self.kind == "tdpa":
                        energies[0].take(extra, number * PERIOD_NS)
            velocity = scaled(moved, 1.0 / PERIOD_S)
            if self.kind == "wave":
                force = wave_hand.force(velocity, to_hand.take())
            else:
                force = tdpa_hand.force(shown, velocity) if self.kind == "tdpa" else shown
            places[k], forces[k] = here[0], force[0]
            hand.move(scaled(force, -1.0))
            # the arm
            for number, (place, extra) in self.forward.arrived(k):
                if self.kind == "wave":
                    to_arm.put(extra)
                if number > newest["forward"]:
                    newest["forward"], wanted = number, place
                    if self.kind == "tdpa":
                        energies[1].take(extra, number * PERIOD_NS)
            state, out = self.servo.step(state, None if state else Reference(np.array(start)), k, k * PERIOD_NS)
            assert out is not None
            assert state is not None
            stretch = minus(target, state.position_m)
            if self.kind == "wave":
                step = wave_arm.step(to_arm.take(), stretch)
                extra, felt = wave_arm.moved(stretch, step)
            elif self.kind == "tdpa":
                step = tdpa_arm.step(minus(wanted, target), stretch)
                energy, felt = tdpa_arm.moved(stretch, step)
                extra = energy
            else:
                step, extra = minus(wanted, target), 0.0
                assert out.force_n is not None
                felt = scaled(out.force_n, -1.0)
            target = plus(target, step)
            state, _ = self.servo.step(state, Reference(np.array(target)), k, k * PERIOD_NS)
            self.back.send(k, (felt, extra))
        return places, forces


def energy_j(places: Array, forces: Array) -> Array:
    """E(t) = sum of F_k (x_{k+1} - x_k), from the hand into the coupling."""
    return np.concatenate([[0.0], np.cumsum(forces[:-1] * np.diff(places))])
