"""Results behind `docs/research/paper.md`: what the paper prints, its simulation, and the cells of the tables."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.estimators import scenario_name, short_name
from tis.common.metrics.tracking import Scorable, score
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario
from tis.common.sources.trajectory import HandRecording
from tis.common.streams import Stream
from tis.deploy.compare.cells.cell import Cell as Twin
from tis.deploy.compare.cells.identity import cell_of, dump
from tis.deploy.compare.results.pooled import pooled
from tis.patient_side.filters.paper_kalman import paper_filter
from tis.patient_side.linear_system import Array
from tis.patient_side.statespace import ArmModel

# Simulation of the paper: Algorithm 1 on the arrays of a whole trial, with delays drawn per sample.

# Printed results of the paper: "Network Parameters and KF Estimation Accuracy for Tactile Internet Scenarios".
#
# Lashari, Batayneh, Khokhar and Ahmed, "Enhanced Position Estimation in Tactile Internet-Enabled Remote Robotic
# Surgery Using MOESP-Based Kalman Filter". n_j is called a variance there and used as a standard deviation.

Axes = tuple[float, float, float]

BLOCK_ROWS: Final = 10
ORDER: Final = 10
TRAIN_SAMPLES: Final = 1240


@dataclass(frozen=True)
class PaperRow:
    """One row: jitter n_j and the bounds of the delay n_d in ms, loss in per cent, accuracy in per cent, RMSE."""

    number: int
    jitter_ms: float
    low_ms: float
    high_ms: float
    loss_pct: float
    accuracy_pct: Axes
    rmse: Axes

    @property
    def delay_text(self) -> str:
        """Return n_d as the paper writes it."""
        return f"{self.low_ms:g}" if self.low_ms == self.high_ms else f"{self.low_ms:g} - {self.high_ms:g}"


@dataclass(frozen=True)
class PaperText:
    """Figures of the section "Summary of Position x, y, z Graphs", which names no network."""

    accuracy_pct: Axes
    rmse: Axes


TEXT: Final = PaperText((94.80, 95.99, 97.67), (0.0331, 0.0297, 0.0243))

ROWS: Final = (
    PaperRow(1, 0.5, 0.5, 2, 0.01, (96.67, 95.13, 97.52), (0.0363, 0.0308, 0.0333)),
    PaperRow(2, 0.5, 0.5, 2, 0.001, (95.58, 95.61, 97.60), (0.0356, 0.0310, 0.0337)),
    PaperRow(3, 0.1, 1, 1, 0.01, (98.68, 98.70, 99.00), (0.0232, 0.0196, 0.0239)),
    PaperRow(4, 2.0, 5, 5, 0.001, (88.46, 89.32, 93.65), (0.0600, 0.0575, 0.0581)),
    PaperRow(5, 1.0, 1, 1, 0.001, (90.66, 88.67, 93.47), (0.0644, 0.0600, 0.0523)),
    PaperRow(6, 3.0, 200, 5000, 1, (85.95, 87.68, 90.95), (0.0811, 0.0766, 0.0748)),
)


Reading = Literal["ms", "samples"]


@dataclass(frozen=True)
class Simulated:
    """Score of one simulation (names as in summary.json) and its mean drawn delay, in samples."""

    score: dict[str, Any]
    mean_delay_samples: float


class Track(NamedTuple):
    """One run of Algorithm 1: estimate (N, 3) in m, NaN where it diverged, and the delays (N,) in samples."""

    estimate_m: Array
    delays: NDArray[np.int64]


def run_algorithm(
    row: PaperRow, reading: Reading, model: ArmModel, hand: HandRecording, rate_hz: int, seed: int, as_printed: bool
) -> Track:
    """Run Algorithm 1 over all rows of ``hand``.

    The delay is ``round(n_d / dt + randn n_j / dt)``, halves away from zero as MATLAB rounds, with dt the sample
    period (``ms``) or 1 (``samples``). All variants of a row see the same draws.
    """
    n = len(hand.command)
    dt_ms = 1000.0 / rate_hz if reading == "ms" else 1.0
    u = {
        what: Stream.named(seed, f"paper/{row.number}/{what}").uniforms(0, n) for what in ("delay", "jitter", "loss")
    }
    delay_ms = row.low_ms + (row.high_ms - row.low_ms) * u["delay"] + row.jitter_ms * scipy.special.ndtri(u["jitter"])
    raw = delay_ms / dt_ms  # may be negative, as in the paper: it then reads the future
    delays = np.copysign(np.floor(np.abs(raw) + 0.5), raw).astype(np.int64)
    lost = u["loss"] <= row.loss_pct / 100
    estimate = paper_filter(
        hand.command.position_m - model.input_offset_m,
        hand.follower.position_m - model.output_offset_m,
        model.space,
        model.noise.Q,
        model.noise.R,
        delays,
        lost,
        as_printed=as_printed,
    )
    # The squares of a diverged filter overflow; such a row counts as missing.
    return Track(np.where(np.abs(estimate) < 1e100, estimate, np.nan) + model.output_offset_m, delays)


def simulate(
    row: PaperRow, reading: Reading, model: ArmModel, hand: HandRecording, rate_hz: int, seed: int, as_printed: bool
) -> Simulated:
    """Score a run of Algorithm 1 on all rows of ``hand``, in the sample that it was identified on."""
    found = run_algorithm(row, reading, model, hand, rate_hz, seed, as_printed)
    n, arm_m = len(hand.command), hand.follower.position_m
    used = np.clip(np.arange(n) - found.delays, 0, n - 1)
    everything = np.ones(n, dtype=np.bool_)
    range_m = model.output_high_m - model.output_low_m
    scored = score(Scorable(found.estimate_m, arm_m[used], arm_m, everything, range_m))
    return Simulated(dict(scored), float(found.delays.mean()))


Pairing = Literal["same_name", "cross"]
Topology = Literal["observer", "teleoperation"]
Sample = Literal["in sample", "held out"]
Method = Literal["moesp_paper", "moesp"]

ESTIMATORS: Final[dict[Method, tuple[str, ...]]] = {
    "moesp_paper": ("hold", scenario_name("paper"), scenario_name("paper_as_printed")),
    "moesp": ("hold", "moesp_kf"),
}
_MS_PER_SAMPLE: Final = 1000 / 30


@dataclass(frozen=True)
class Trial:
    """Trial behind the tables."""

    path: str | None
    task: str
    name: str
    seed: int


@dataclass(frozen=True)
class Cell:
    """One twin: a row of the paper, one reading of its delays, and one value of each other choice."""

    row: PaperRow
    reading: Reading
    pairing: Pairing
    topology: Topology
    sample: Sample
    method: Method


def scenario_of(trial: Trial, pairing: Pairing, method: Method = "moesp", **changes: Any) -> Scenario:
    """Return the base scenario of all cells of a pairing, which identifies on the trial's own head."""
    identification = {"method": method, "train_samples": TRAIN_SAMPLES, "block_rows": BLOCK_ROWS}
    if method == "moesp_paper":
        identification["order"] = ORDER
    raw: dict[str, Any] = {
        "version": 1,
        "name": "paper",
        "seed": trial.seed,
        "duration_s": 1,
        "source": {
            "kind": "jigsaws",
            "path": trial.path,
            "task": trial.task,
            "trial": trial.name,
            "pairing": pairing,
            "clock": "as_recorded",  # as the paper had them
        },
        "identification": identification,
        "estimators": ESTIMATORS[method],
        "active_estimator": ESTIMATORS[method][1],
    }
    return build_scenario(raw | changes, "tis paper")


def twin_of(cell: Cell, trial: Trial, n_rows: int, model_file: Path) -> Twin:
    """Return the twin of a cell, with the models of a file, in a trial of ``n_rows``.

    A given model lets the run begin within the training rows. With the reading ``samples`` a delay of d means d
    sample periods.
    """
    row, scale = cell.row, 1.0 if cell.reading == "ms" else _MS_PER_SAMPLE
    start = 0 if cell.sample == "in sample" else TRAIN_SAMPLES
    forward = {
        "loss": {"kind": "bernoulli", "p_loss": row.loss_pct / 100},
        "delay": {"kind": "uniform", "low_ms": row.low_ms * scale, "high_ms": row.high_ms * scale},
        "jitter": {"kind": "normal", "std_ms": row.jitter_ms * scale},
        "ordering": "reorder",
    }
    raw = dump(scenario_of(trial, cell.pairing, cell.method))
    raw |= {"topology": cell.topology, "duration_s": (n_rows - 1 - start) / 30, "drain_s": 0}
    raw |= {"network": {"forward": forward}}
    raw["source"] |= {"start": start}
    raw["identification"] |= {"train": str(model_file)}
    setting = f"row {row.number}, {cell.reading}, {cell.pairing}, {cell.topology}, {cell.sample}"
    return cell_of(build_scenario(raw, "tis paper"), setting, trial.name, None, {})


def scores_of(result: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scores by estimator, names as in summary.json, of a twin's result."""
    (hand,) = result["hands"].values()
    return {short_name(name): pooled([[hand]], name) for name in hand["estimators"]}


PAIRINGS: Final[tuple[Pairing, ...]] = ("same_name", "cross")
TOPOLOGIES: Final[tuple[Topology, ...]] = ("observer", "teleoperation")
SAMPLES: Final[tuple[Sample, ...]] = ("in sample", "held out")
METHODS: Final[tuple[Method, ...]] = ("moesp_paper", "moesp")
READINGS: Final[tuple[Reading, ...]] = ("ms", "samples")

SimulationKey = tuple[Pairing, int, Reading, bool]


@dataclass(frozen=True)
class Results:
    """All values of the page."""

    trial: Trial
    label: str
    models: dict[tuple[Pairing, Method], ArmModel]
    simulated: dict[SimulationKey, Simulated]
    epsilons: dict[tuple[float, float], dict[str, Any]]
    cells: dict[Cell, dict[str, Any]]


def meaningful(row: PaperRow, reading: Reading) -> bool:
    """Tell whether a reading makes sense: row 6 in samples would delay by up to 167 s, longer than a trial."""
    return not (row.number == 6 and reading == "samples")


def all_cells() -> list[Cell]:
    """Return the cells of all tables, on packets."""
    return [
        Cell(row, reading, pairing, topology, sample, method)
        for pairing in PAIRINGS
        for topology in TOPOLOGIES
        for sample in SAMPLES
        for row in ROWS
        for reading in READINGS
        if meaningful(row, reading)
        for method in METHODS
    ]


def few_cells() -> list[Cell]:
    """Return the cells of one table, an eighth of all: the case of a patient's side, which the conclusions use."""
    wanted = ("cross", "teleoperation", "held out")
    return [cell for cell in all_cells() if (cell.pairing, cell.topology, cell.sample) == wanted]
