"""Estimators on devices that their model does not fit: ``python -m tests.patient_side.estimators.bench_devices``.

RMSE over hold's, in three minutes. A pointer's events hold between instants of their own, and are read at 30 and 100
rows a second by models that were trained on the synthetic hand of `drive`; noise of which rows at 50 Hz had none.
"""

from collections.abc import Callable

import numpy as np

from tis.common.runtime.recordings import load_movement
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import synthesise
from tis.common.units import NS_PER_S
from tis.deploy.run.resolve import resolve
from tis.patient_side.estimators.builders import build_estimator
from tis.patient_side.linear_system import Array
from tis.patient_side.models import models_for
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

NAMES = ("hold", "damped_velocity", "innovations_kf")
SKIPPED_S, MOUSE_S, EVENT_HZ, READ_OFF_S, FINE_HZ, QUANTUM_M = 3, 60, 60, 0.004, 1000, 0.25e-3


def mouse_m(seed: int, rate_hz: int) -> Array:
    """Return rows (N, 3) of a pointer that goes smoothly to random places, and rests there (Flash and Hogan 1985)."""
    rng, moves, at = np.random.default_rng(seed), [np.zeros((1, 3))], np.zeros(3)
    while sum(map(len, moves)) < MOUSE_S * FINE_HZ:
        moves.append(np.repeat(at[None], int(rng.uniform(0.1, 0.9) * FINE_HZ), axis=0))
        to = np.r_[rng.uniform(-0.06, 0.06, 2), 0.0 if rng.random() < 0.8 else rng.uniform(-0.02, 0.02)]
        lasts_s = 0.25 + 0.12 * np.log2(1 + np.linalg.norm(to - at) / 0.008) * rng.uniform(0.8, 1.2)
        s = np.linspace(0, 1, int(lasts_s * FINE_HZ))[:, None]
        moves.append(at + (to - at) * (10 * s**3 - 15 * s**4 + 6 * s**5))
        at = to
    path_m = np.round(np.concatenate(moves) / QUANTUM_M) * QUANTUM_M
    # Each row reads the newest event, up to READ_OFF_S before or after the row's instant.
    t_s = np.arange(MOUSE_S * rate_hz) / rate_hz
    events = np.floor(np.maximum(t_s + rng.uniform(-READ_OFF_S, READ_OFF_S, len(t_s)), 0.0) * EVENT_HZ)
    read: Array = path_m[np.minimum(events / EVENT_HZ * FINE_HZ, len(path_m) - 1).astype(int)]
    return read


def ratios(model: ArmModel, movements: list[Array], rate_hz: int, delay_s: float) -> str:
    """Return the errors of all estimators over hold's, pooled over movements (N, 3) that are scaled by half."""
    squares: dict[str, float] = dict.fromkeys(NAMES, 0.0)
    for rows in movements:
        for name in NAMES:
            estimator, playout, n = build_estimator(name, model), Playout(rate_hz), 0
            state = estimator.initial()
            for k in range(len(rows) - 1):
                now_s = (k + 0.5) / rate_hz
                for i in range(n, min(k, int((now_s - delay_s) * rate_hz + 1e-9)) + 1 if now_s >= delay_s else 0):
                    playout.arm.add(i, rows[i].copy())
                    playout.command.add(i, 2.0 * rows[i])
                    n = i + 1
                state, found = estimator.step(state, playout, round(now_s * NS_PER_S))
                if k >= SKIPPED_S * rate_hz and found.position_m is not None:
                    squares[name] += float(np.sum((found.position_m - (rows[k] + rows[k + 1]) / 2) ** 2))
    return "  ".join(f"{name} {np.sqrt(squares[name] / squares['hold']):.2f}" for name in NAMES[1:])


def trained(name: str, *settings: str) -> ArmModel:
    scenario = resolve(name, settings)
    return models_for(scenario, load_movement(scenario))[0]


def main(tell: Callable[[str], None] = print) -> None:
    for rate_hz in (30, 100):
        model, movements = trained("drive", f"rate_hz={rate_hz}"), [mouse_m(seed, rate_hz) for seed in range(3)]
        for delay_ms in (33, 100, 300, 1000):
            told = ratios(model, movements, rate_hz, delay_ms / 1000)
            tell(f"mouse read at {rate_hz:3} Hz, {delay_ms:4} ms:  {told}")
    source = "source={kind: synthetic, hands: [left], recorder_hz: null}"
    model = trained("default", "rate_hz=50", "identification.train_samples=1000", source)
    hand = SyntheticSource(kind="synthetic", hands=["left"])
    paths = [synthesise(hand, seed, 50, 2000, 0).hands[0].follower.position_m for seed in range(100, 104)]
    for noise_mm in (0.0, 0.02, 0.2):
        noisy = [y + noise_mm / 1000 * np.random.default_rng(i).normal(size=y.shape) for i, y in enumerate(paths)]
        tell(f"noise of {noise_mm:4} mm at 50 Hz, 100 ms:  {ratios(model, noisy, 50, 0.1)}")


if __name__ == "__main__":
    main()
