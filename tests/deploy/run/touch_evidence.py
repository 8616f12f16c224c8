"""Evidence for touch in the twin: critical stiffness, stiffness shown by waves, energy given to the hand.

``python -m tests.deploy.run.touch_evidence limits|waves|energy|estimators`` prints a table; all take half an hour of
a core, and ``limits 3`` begins with case 3. Energies are summed here from the messages' JSON.
"""

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from math import cos, pi, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tis.common.coupling.stability import Arm, Limb, critical_stiffness, loop_limit
from tis.common.estimators import ESTIMATORS, LEARNED
from tis.common.node import Record
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, drive

Array = NDArray[np.float64]
TICK_S: Final = 1e-3
PLAIN: Final = (
    "identification.train_samples=1000", "patient.tick_phase_ms=0.5", "drain_s=0.1",
    "touch.environment.distance_mm=0", "touch.environment.damping_ns_m=0",
)  # fmt: skip
SERVO: Final = "patient.plant={kind: servo, bandwidth_hz: 5.8, damping: 0.5, mass_kg: 0.3}"
SHIPPED: Final = tuple(name for name in ESTIMATORS if name not in LEARNED)
HANDS: Final = {"Hogan": Limb(0.9, 6.0, 568.0), "Yokokohji": Limb(2.1, 2.5, 10.0)}


@dataclass
class Kept:
    """Recorder that keeps the forces shown to the hand."""

    rows: list[dict[str, Any]] = field(default_factory=list)

    def record(self, record: Record) -> None:
        if record.topic.endswith("/servo_cf") and isinstance(record.data, bytes):
            self.rows.append(json.loads(record.data))

    def along_z(self, field_: str) -> Array:
        return np.array([row[field_]["z"] for row in self.rows])

    def energy_mj(self) -> Array:
        """E(t) = sum of F_k (x_{k+1} - x_k), from the hand into the coupling."""
        places, forces = (
            np.array([[row[name][axis] for axis in "xyz"] for row in self.rows]) for name in ("position_m", "force_n")
        )
        return 1000.0 * np.cumsum((-forces[:-1] * np.diff(places, axis=0)).sum(axis=1))


def run(
    intended_mm: Callable[[float], float] | None, *settings: str, estimators: str = "[hold]"
) -> tuple[Scenario, Kept]:
    """Run a twin whose hand intends ``intended_mm`` along z, s after its begin; None: the scenario's movement."""
    scenario = resolve("touch", (*PLAIN, f"estimators={estimators}", *settings), None, None)
    recording = load_recording(scenario)
    if intended_mm is not None:
        hands = []
        for hand in recording.hands:
            place = hand.follower.position_m.copy()
            first = recording.start
            place[first:] = place[first]
            place[first:, 2] += [intended_mm(i * TICK_S) / 1000.0 for i in range(len(place) - first)]
            hands.append(replace(hand, follower=replace(hand.follower, position_m=place)))
        recording = replace(recording, hands=tuple(hands))
    nodes, _, _ = build_sides(scenario, recording=recording)
    kept = Kept()
    drive(scenario, nodes, {"surgeon": kept, "netem": Kept(), "patient": Kept()})
    return scenario, kept


def growth_per_s(signal: Array, w: float) -> float:
    """Return how fast the swing of a signal near w rad/s grows, by its size in whole swings early and late."""
    swings = max(int(0.3 * len(signal) * TICK_S * w / (2 * pi)), 1)
    n = round(swings * 2 * pi / w / TICK_S)
    off = signal - signal[-2 * n :].mean()
    early, late = off[len(off) - 3 * n : len(off) - 2 * n], off[-n:]
    return float(np.log(np.std(late) / np.std(early)) / (2 * n * TICK_S))


def operator(limb: Limb) -> tuple[str, ...]:
    hand = {"mass_kg": limb.mass_kg - 0.1, "damping_ns_m": limb.damping_ns_m - 0.5}
    return tuple(f"touch.operator.{name}={value}" for name, value in (*hand.items(), ("stiffness_n_m", limb[2])))


def delayed(ms: float, more: str = "") -> str:
    """Return the network with this delay each way."""
    way = f"{{delay: {{kind: constant, delay_ms: {ms}}}, {more}}}"
    return f"network={{forward: {way}, feedback: {way}}}"


def press(deep_mm: float) -> Callable[[float], float]:
    """Press within 3 s, with a tap at 4 s that swings the loop."""

    def intended_mm(t: float) -> float:
        tap = 0.02 * deep_mm * (1 - cos(2 * pi * min(max(t - 4.0, 0.0) / 0.2, 1.0)))
        return -deep_mm * (1 - cos(pi * min(t / 3.0, 1.0))) / 2 - tap

    return intended_mm


def limits() -> Iterator[str]:
    """Yield the critical stiffness of each case: found where the growth of a swing passes zero, and by theory."""
    cases = [(name, n) for name in HANDS for n in (10, 50, 100, 200)]
    cases += [("Hogan", 20), ("Hogan", 70), ("Yokokohji", 30), ("Yokokohji", 150)]
    skipped = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    for servo in (False, True):
        for name, n in cases[skipped:] if not servo else cases[:3]:
            limb, half = HANDS[name], (n - 2) // 2
            arm = Arm(5.0, 1.0, 0.3) if servo else Arm(1000.0, 1.0, 100.0)
            wanted = critical_stiffness(limb, (n + 0.5) * TICK_S)
            if servo:
                wanted = loop_limit(limb, arm, (n - 1) * TICK_S, TICK_S)
            w = sqrt((limb.stiffness_n_m + wanted) / limb.mass_kg)
            found = []
            for share in (0.97, 1.03):
                _, kept = run(
                    press(200.0 if limb.stiffness_n_m < 100 else 12.0),
                    "duration_s=16", "patient.safety.enabled=false", "touch.force_max_n=900",
                    "touch.fade_after_ms=2000", delayed(half - 0.1),
                    f"patient.plant={{kind: servo, bandwidth_hz: {arm.bandwidth_hz}, mass_kg: {arm.mass_kg}}}",
                    f"touch.environment.stiffness_n_m={share * wanted}", *operator(limb),
                )  # fmt: skip
                trip_ms = (kept.rows[-1]["sample_ns"] - kept.rows[-1]["command_ns"]) / 1e6
                found.append(growth_per_s(kept.along_z("force_n")[4500:], w))
            low, high = found
            critical = wanted * (0.97 + 0.06 * low / (low - high))
            error = 100 * (critical / wanted - 1)
            kind = "servo, Nyquist" if servo else "ideal arm, equation 1"
            found_text = f"theory {wanted:7.1f}  twin {critical:7.1f} N/m  {error:+.2f} %"
            yield f"{kind:22} {name:10} {n:4} ms trip {trip_ms:6.1f}  {found_text}"


def waves() -> Iterator[str]:
    """Yield the stiffness that waves show in nine cases, and that of wall, servo and line in series."""
    for stiffness in (200.0, 400.0, 1500.0):
        for n in (10, 50, 100):
            scenario, kept = run(
                lambda t: -10.0 * (1 - cos(pi * min(t / 4.0, 1.0))),
                "duration_s=11", "touch.coupling=wave", "touch.fade_after_ms=2000",
                f"touch.environment.stiffness_n_m={stiffness}",
                SERVO, delayed(n - 0.5),
            )  # fmt: skip
            part = scenario.touch
            assert part is not None
            plant = scenario.patient.plant
            spring = 0.3 * (2 * pi * plant.bandwidth_hz) ** 2  # type: ignore[union-attr]
            wanted = 1 / (1 / stiffness + 1 / spring + (n + 0.5) * TICK_S / part.impedance_ns_m)
            first = kept.along_z("position_m")[0]
            shown = -kept.along_z("force_n")[-2000:].mean() / (kept.along_z("position_m")[-2000:].mean() - first)
            error = 100 * (shown / wanted - 1)
            yield f"Ke {stiffness:6.0f} Td {n:4} ms  theory {wanted:7.2f}  twin {shown:7.2f} N/m  {error:+.2f} %"


def energy(names: tuple[str, ...] = ("hold", "innovations_kf")) -> Iterator[str]:
    """Yield the least energy of passive couplings over loss, jitter, duplicates and estimators; and without."""
    bad = "loss: {kind: bernoulli, p_loss: 0.1}, jitter: {kind: normal, std_ms: 1}, duplicate: {p_duplicate: 0.05}"
    for coupling in ("wave", "tdpa", "position_force"):
        for stiffness in (400, 1500):
            for n in (25, 50, 100):
                for name, worse in [(name, worse) for name in names for worse in ("", bad)]:
                    if coupling == "position_force" and (worse or name != "hold"):
                        continue
                    _, kept = run(
                        None, "duration_s=6", f"touch.coupling={coupling}", "touch.fade_after_ms=1000",
                        SERVO, f"touch.environment.stiffness_n_m={stiffness}", delayed(n, worse),
                        f"active_estimator={name}",
                        estimators=str([*dict.fromkeys(["hold", name])]),
                    )  # fmt: skip
                    limit = critical_stiffness(HANDS["Hogan"], (2 * n + 1) * TICK_S)
                    case = f"Ke {stiffness:5} (limit {limit:5.0f}) Td {n:4} ms {'bad' if worse else 'clean':5}"
                    yield f"{coupling:14} {name:16} {case} least {kept.energy_mj().min():10.4f} mJ"


def main() -> None:
    """Print the tables that are asked for."""
    tables: dict[str, Callable[[], Iterator[str]]] = {
        "limits": limits, "waves": waves, "energy": energy, "estimators": lambda: energy(SHIPPED),
    }  # fmt: skip
    for name in sys.argv[1:2] or ("limits", "waves", "energy"):
        for line in tables[name]():
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
