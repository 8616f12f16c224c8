"""Results behind `docs/research/paper.md`: axes of its tables and computed values of their cells."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from tis.common.estimators import scenario_name, short_name
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario
from tis.deploy.compare.cells.cell import Cell as Twin
from tis.deploy.compare.cells.identity import cell_of, dump
from tis.deploy.compare.results.pooled import pooled
from tis.deploy.studies.paper.printed import BLOCK_ROWS, ORDER, ROWS, TRAIN_SAMPLES, PaperRow
from tis.deploy.studies.paper.simulation import Reading, Simulated
from tis.patient_side.statespace import ArmModel

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
