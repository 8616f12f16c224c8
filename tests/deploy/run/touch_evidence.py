"""Evidence for touch in the twin: critical stiffness, stiffness shown by waves, energy given to the hand.

``python -m tests.deploy.run.touch_evidence limits|waves|energy`` prints a table, with two processes; ``limits Hogan``
and ``energy tdpa`` take the cases with that word.
"""

import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from math import ceil, cos, pi, sin, sqrt
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from tests.deploy.run.energy_from_logs import Array, energy_mj, rows, vectors
from tis.common.coupling.stability import Arm, Limb, critical_stiffness, loop_limit
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import run_twin
from tis.netem.build import build_netem
from tis.patient_side.build import build_patient
from tis.patient_side.models import models_for
from tis.patient_side.statespace import ArmModel
from tis.surgeon_side.build import build_surgeon

TICK_S: Final = 1e-3
PLAIN: Final = (
    "identification.train_samples=1000", "patient.tick_phase_ms=0.5", "drain_s=0.1",
    "touch.environment.distance_mm=0", "touch.environment.damping_ns_m=0",
)  # fmt: skip
SERVO: Final = "patient.plant={kind: servo, bandwidth_hz: 5.8, damping: 0.5, mass_kg: 0.3}"
ESTIMATORS: Final = ("hold", "damped_velocity", "moesp_kf", "arx_kf", "innovations_kf")
HANDS: Final = {"Hogan": Limb(0.9, 6.0, 568.0), "Yokokohji": Limb(2.1, 2.5, 10.0)}
IDEAL: Final = Arm(1000.0, 1.0, 100.0)
"""Its spring of 4e9 N/m settles within a tick but for 1.4 % of the step, as 0.014 ms more delay."""
MASSIVE: Final = Arm(5.0, 1.0, 0.3)
BAD: Final = "loss: {kind: bernoulli, p_loss: 0.1}, jitter: {kind: normal, std_ms: 1}, duplicate: {p_duplicate: 0.05}"


@cache
def _models(names: str) -> tuple[ArmModel, ...]:
    """Return the models of these estimators, which touch does not change."""
    scenario = resolve("touch", (*PLAIN, f"estimators={names}", "duration_s=1"), None, None)
    return models_for(scenario, load_recording(scenario))


def run(run_dir: Path, intended_mm: Callable[[float], float], *settings: str, estimators: str = "[hold]") -> Scenario:
    """Run a twin whose hand intends ``intended_mm`` along z, s after its begin."""
    scenario = resolve("touch", (*PLAIN, f"estimators={estimators}", *settings), None, None)
    recording, models = load_recording(scenario), _models(estimators)
    hands = []
    for hand in recording.hands:
        place = hand.follower.position_m.copy()
        first = recording.start
        place[first:] = place[first]
        place[first:, 2] += [intended_mm(i * TICK_S) / 1000.0 for i in range(len(place) - first)]
        hands.append(replace(hand, follower=replace(hand.follower, position_m=place)))
    recording = replace(recording, hands=tuple(hands))
    run_twin(
        scenario,
        {
            "surgeon": build_surgeon(scenario, recording),
            "netem": build_netem(scenario, {}),
            "patient": build_patient(scenario, models, recording),
        },
        models,
        run_dir,
    )
    return scenario


def shown(run_dir: Path) -> list[dict[str, Any]]:
    """Return the forces shown to the hand."""
    return list(rows(run_dir, "surgeon", "tis/MTML/servo_cf"))


def growth_per_s(signal: Array, step: int) -> float:
    """Return the rate of the fastest growing oscillation in every ``step``-th sample of a signal without noise.

    Its samples are a sum of powers of the loop's poles: a matrix pencil finds these, without a whole number of swings
    or a long wait (Hua and Sarkar 1990). Of the differences, as a constant is no oscillation.
    """
    y = np.diff(signal[::step])
    windows = np.lib.stride_tricks.sliding_window_view(y / np.abs(y).max(), len(y) // 3)
    _, sizes, axes = np.linalg.svd(windows, full_matrices=False)
    space = axes[: min(int((sizes > 1e-6 * sizes[0]).sum()), 12)].T
    poles = np.linalg.eigvals(np.linalg.lstsq(space[:-1], space[1:], rcond=None)[0])
    powers = poles[None, :] ** np.arange(len(y))[:, None]
    shares = np.abs(np.linalg.lstsq(powers, y / np.abs(y).max(), rcond=None)[0]) * np.abs(poles) ** len(y)
    return float(np.log(np.abs(poles[shares > 1e-3 * shares.max()])).max() / (step * TICK_S))


def operator(limb: Limb) -> tuple[str, ...]:
    hand = {"mass_kg": limb.mass_kg - 0.1, "damping_ns_m": limb.damping_ns_m - 0.5}
    return tuple(f"touch.operator.{name}={value}" for name, value in (*hand.items(), ("stiffness_n_m", limb[2])))


def delayed(ms: float, more: str = "") -> str:
    """Return the network with this delay each way."""
    way = f"{{delay: {{kind: constant, delay_ms: {ms}}}, {more}}}"
    return f"network={{forward: {way}, feedback: {way}}}"


def plant(arm: Arm) -> str:
    return f"patient.plant={{kind: servo, bandwidth_hz: {arm[0]}, damping: {arm[1]}, mass_kg: {arm[2]}}}"


@dataclass(frozen=True)
class Press:
    """A press of three swings, which leaves none, and a tap, which leaves one that is small beside the press.

    A wall that is much stiffer than the hand's spring lets go of a hand that swings: this is no loop any more.
    """

    deep_mm: float
    swing_s: float
    tap_mm: float

    def __call__(self, t: float) -> float:
        share = min(t / (3 * self.swing_s), 1.0)
        tap = min(max(t - 3 * self.swing_s, 0.0) / (0.5 * self.swing_s), 1.0)
        return -self.deep_mm * (share - sin(2 * pi * share) / (2 * pi)) - self.tap_mm * (1 - cos(2 * pi * tap)) / 2


def growth_in_twin(limb: Limb, arm: Arm, n: int, stiffness_n_m: float) -> float:
    """Return the growth of a swing of hand and wall over ``n`` ms, in 1/s, in a twin of six swings."""
    swing_s = 2 * pi / sqrt((limb.stiffness_n_m + stiffness_n_m) / limb.mass_kg)
    deep_mm = 200.0 if limb.stiffness_n_m < 100 else 12.0
    tap_mm = 0.1 * deep_mm * limb.stiffness_n_m / (limb.stiffness_n_m + stiffness_n_m)
    begin_s = 3.5 * swing_s + 2 * n * TICK_S + 0.05
    end_s = ceil((begin_s + 2.5 * swing_s) * 1000) / 1000
    with TemporaryDirectory() as where:
        run(
            Path(where), Press(deep_mm, swing_s, tap_mm), f"duration_s={end_s}",
            "patient.safety.enabled=false", "touch.force_max_n=900", "touch.fade_after_ms=2000",
            delayed((n - 2) // 2 - 0.1), f"touch.environment.stiffness_n_m={stiffness_n_m}", *operator(limb),
            plant(arm),
        )  # fmt: skip
        forces = shown(Path(where))
    # the newest command when a force was felt was a tick old when the arm had followed it
    assert round((forces[-1]["sample_ns"] - forces[-1]["command_ns"]) / 1e6 + 1, 6) == n
    felt_n = vectors(forces, "force_n")[round(begin_s / TICK_S) :, 2]
    assert felt_n.min() > 0.0, "the hand left the wall"
    return growth_per_s(felt_n, max(round(swing_s / TICK_S / 24), 1))


def limit(case: tuple[str, str, int]) -> str:
    """Bisect the sign of the growth in shares of the theory's stiffness, to a quarter of a per cent."""
    kind, name, n = case
    limb, within = HANDS[name], 0.01 if kind == "ideal" else 0.03
    arm = IDEAL if kind == "ideal" else MASSIVE
    wanted = critical_stiffness(limb, (n + 0.5) * TICK_S)
    if kind != "ideal":
        wanted = loop_limit(limb, arm, (n - 1) * TICK_S, TICK_S)
    low, high = 1.0 - within, 1.0 + within
    text = f"{kind:6} {name:10} {n:4} ms  theory {wanted:7.1f} N/m"
    ends = [growth_in_twin(limb, arm, n, share * wanted) for share in (low, high)]
    if not ends[0] < 0.0 < ends[1]:
        return f"{text}  NOT within {100 * within:.0f} %: growth {ends[0]:+.4f} and {ends[1]:+.4f} 1/s at the ends"
    while high - low > 0.0026:
        middle = 0.5 * (low + high)
        if growth_in_twin(limb, arm, n, middle * wanted) < 0.0:
            low = middle
        else:
            high = middle
    error = f"{100 * (low - 1):+.2f} to {100 * (high - 1):+.2f} %"
    return f"{text}  twin {low * wanted:7.1f} to {high * wanted:7.1f}  {error}"


def limits() -> Iterator[tuple[str, str, int]]:
    """Yield the cases of equation 1 with an ideal arm, then those of the whole loop with the servo's mass."""
    for name, trips in (("Hogan", (10, 20, 50, 70, 100, 200)), ("Yokokohji", (10, 30, 50, 100, 150, 200))):
        yield from (("ideal", name, n) for n in trips)
    yield from (("servo", "Hogan", n) for n in (10, 50, 100))
    yield ("servo", "Yokokohji", 50)


def wave_stiffness(case: tuple[float, int]) -> str:
    """Compare the stiffness that waves show with that of wall, servo and line in series."""
    stiffness, n = case
    with TemporaryDirectory() as where:
        scenario = run(
            Path(where),
            lambda t: -10.0 * (1 - cos(pi * min(t / 4.0, 1.0))),
            "duration_s=11", "touch.coupling=wave", "touch.fade_after_ms=2000",
            f"touch.environment.stiffness_n_m={stiffness}",
            SERVO, delayed(n - 0.5),
        )  # fmt: skip
        forces = shown(Path(where))
    part, plant = scenario.touch, scenario.patient.plant
    assert part is not None
    spring = 0.3 * (2 * pi * plant.bandwidth_hz) ** 2  # type: ignore[union-attr]
    wanted = 1 / (1 / stiffness + 1 / spring + (n + 0.5) * TICK_S / part.impedance_ns_m)
    places, felt_n = vectors(forces, "position_m")[:, 2], vectors(forces, "force_n")[:, 2]
    found = -felt_n[-2000:].mean() / (places[-2000:].mean() - places[0])
    error = 100 * (found / wanted - 1)
    return f"Ke {stiffness:6.0f} Td {n:4} ms  theory {wanted:7.2f}  twin {found:7.2f} N/m  {error:+.2f} %"


def waves() -> Iterator[tuple[float, int]]:
    """Yield nine cases of wall and delay."""
    yield from ((stiffness, n) for stiffness in (200.0, 400.0, 1500.0) for n in (10, 50, 100))


def least_energy(case: tuple[str, str, int, int, str]) -> str:
    """Return the least energy in a twin's log; position-force has the ideal arm of equation 1, and time to grow."""
    coupling, name, stiffness, n, network = case
    is_plain = coupling == "position_force"
    with TemporaryDirectory() as where:
        run(
            Path(where), Press(20.0 if is_plain else 10.0, 0.2, 1.0),
            f"duration_s={6 if is_plain else 2}", f"touch.coupling={coupling}",
            "touch.fade_after_ms=1000", plant(IDEAL) if is_plain else SERVO, f"active_estimator={name}",
            f"touch.environment.stiffness_n_m={stiffness}", delayed(n, BAD if network == "bad" else ""),
            estimators=str([*dict.fromkeys(["hold", name])]),
        )  # fmt: skip
        energy, forces = energy_mj(Path(where)), vectors(shown(Path(where)), "force_n")
    critical = critical_stiffness(HANDS["Hogan"], (2 * n + 1) * TICK_S)
    ends = f"least {energy.min():10.4f} last {energy[-1]:9.3f} mJ, most force {np.abs(forces).max():6.2f} N"
    return f"{coupling:14} {name:15} Ke {stiffness:5} (limit {critical:4.0f}) Td {n:4} ms {network:5} {ends}"


def energy() -> Iterator[tuple[str, str, int, int, str]]:
    """Yield position-force past its limit, then both passive couplings with every estimator, and a bad network."""
    walls = [(stiffness, n) for stiffness in (400, 1500) for n in (25, 50, 100)]
    yield from (("position_force", "hold", *wall, "clean") for wall in walls)
    for name in ESTIMATORS:
        for coupling in ("wave", "tdpa"):
            yield from ((coupling, name, *wall, network) for wall in walls for network in ("clean", "bad"))


def main() -> None:
    """Print the tables that are asked for."""
    tables: dict[str, tuple[Callable[[Any], str], Callable[[], Iterable[tuple[Any, ...]]]]] = {
        "limits": (limit, limits), "waves": (wave_stiffness, waves), "energy": (least_energy, energy),
    }  # fmt: skip
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for name in sys.argv[1:2] or tables:
            judge, cases = tables[name]
            wanted = [case for case in cases() if not sys.argv[2:] or sys.argv[2] in case]
            for line in pool.map(judge, wanted):
                sys.stdout.write(f"{line}\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
