"""Known systems, simulated by a plain loop, and recordings made of arrays: what the tests identify from."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import FOLLOWER, SAME_NAME, Hand
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.patient_side.identification.stochastic_moesp import InnovationsForm
from tis.patient_side.linear_system import StateSpace

Array = NDArray[np.float64]

ROTATION = 0.95 * np.array([[0.9, 0.3], [-0.3, 0.9]])

ONE_LAG = StateSpace(0.7 * np.eye(3), 0.15 * np.eye(3), np.eye(3), np.zeros((3, 3)))
"""An arm that follows half of the command, each axis with one pole at 0.7."""


def four_states() -> StateSpace:
    """Return a stable system of 4 states, 2 inputs, 3 outputs, with a complex pair and a negative eigenvalue."""
    rng = np.random.default_rng(11)
    A = np.zeros((4, 4))
    A[:2, :2] = ROTATION
    A[2:, 2:] = [[0.7, 0.2], [0.0, -0.5]]
    return StateSpace(A, rng.normal(size=(4, 2)), rng.normal(size=(3, 4)), rng.normal(size=(3, 2)))


@dataclass(frozen=True)
class Noisy:
    """A system with process noise of covariance ``L L'`` and measurement noise of covariance ``M M'``."""

    space: StateSpace
    L: Array
    M: Array

    def run(self, n_rows: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return inputs and outputs under white input and noises."""
        s = self.space
        u = rng.normal(size=(n_rows, s.n_inputs))
        w = rng.normal(size=(n_rows, s.order)) @ self.L.T
        v = rng.normal(size=(n_rows, s.n_outputs)) @ self.M.T
        x, y = np.zeros(s.order), np.empty((n_rows, s.n_outputs))
        for k in range(n_rows):
            y[k] = s.C @ x + s.D @ u[k] + v[k]
            x = s.A @ x + s.B @ u[k] + w[k]
        return u, y


def markov(space: StateSpace, n: int) -> Array:
    """Return D, CB, CAB, ... (n, p, m), which no choice of coordinates changes."""
    blocks, power = [space.D], np.eye(space.order)
    for _ in range(n - 1):
        blocks.append(space.C @ power @ space.B)
        power = power @ space.A
    return np.array(blocks)


def innovation_markov(form: InnovationsForm, n: int) -> Array:
    """Return C K, C A K, ... (n, p, p): the responses of later outputs to an innovation."""
    return markov(StateSpace(form.A, form.K, form.C, np.eye(len(form.C))), n + 1)[1:]


def sorted_eigenvalues(A: Array) -> NDArray[np.complex128]:
    return np.sort_complex(np.linalg.eigvals(A).astype(np.complex128))


def hand_like(n_rows: int, seed: int, n_axes: int = 3) -> Array:
    """Return a smooth random movement in m: sinusoids below 2 Hz at 30 Hz, and 0.05 mm of tremor."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_rows)[:, None, None] / 30
    frequencies, phases = rng.uniform(0.05, 2.0, (2, 1, 12, n_axes))
    smooth = np.sum(0.01 / (1 + frequencies) * np.sin(2 * np.pi * frequencies * t + 6 * phases), axis=1)
    return np.asarray(smooth + 5e-5 * rng.normal(size=smooth.shape))


def recording(
    label: str, parts: dict[Hand, tuple[Array, Array]], *, rate_hz: int = 30, same_name: bool = False
) -> Recording:
    """Return a recording whose hands have the given commands and arm positions."""
    arms = SAME_NAME if same_name else FOLLOWER
    hands = tuple(HandRecording(hand, arms[hand], _track(u), _track(y)) for hand, (u, y) in parts.items())
    return Recording(label, rate_hz, hands, 0, "as the test says")


def _track(position_m: Array) -> PoseTrack:
    n = len(position_m)
    return PoseTrack(position_m, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros(n))


def real_recording(jigsaws_dir: Path, trial: str, *, same_name: bool = False) -> Recording:
    """Return both hands of a real trial such as ``Suturing_D002``: columns as the data set's description has them."""
    task = trial.rsplit("_", 1)[0]
    rows = np.loadtxt(jigsaws_dir / task / "kinematics" / "AllGestures" / f"{trial}.txt")
    psm1, psm2 = rows[:, 38:41], rows[:, 57:60]
    left, right = (psm1, psm2) if same_name else (psm2, psm1)
    return recording(trial, {"left": (rows[:, 0:3], left), "right": (rows[:, 19:22], right)}, same_name=same_name)


REAL_TRIALS = (
    "Knot_Tying_C002",
    "Knot_Tying_D004",
    "Needle_Passing_D003",
    "Needle_Passing_E001",
    "Suturing_C004",
    "Suturing_D002",
    "Suturing_E003",
    "Suturing_F003",
)
