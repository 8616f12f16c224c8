"""Results behind `docs/research/paper.md`: axes of its tables and computed values of their cells."""

import os
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, Literal

from tis.common.channels import Side
from tis.common.node import Node
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario
from tis.common.sources.trajectory import Recording
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.subjects.accuracy import accuracy_of_hand
from tis.deploy.run.twin import drive
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.paper.printed import BLOCK_ROWS, ORDER, ROWS, TRAIN_SAMPLES, PaperRow
from tis.deploy.studies.paper.simulation import Reading, Simulated
from tis.netem.build import build_netem
from tis.patient_side.build import build_patient
from tis.patient_side.identification.model_file import parse_models
from tis.patient_side.statespace import ArmModel
from tis.surgeon_side.build import build_surgeon

# Cells of the paper's tables: twins in memory, run on all cores.

Pairing = Literal["same_name", "cross"]
Topology = Literal["observer", "teleoperation"]
Sample = Literal["in sample", "held out"]
Method = Literal["moesp_paper", "moesp"]

ESTIMATORS: Final[dict[Method, tuple[str, ...]]] = {
    "moesp_paper": ("hold", "paper", "paper_as_printed"),
    "moesp": ("hold", "moesp_kf"),
}
_MS_PER_SAMPLE: Final = 1000 / 30
_POLL_S: Final = 1.0


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
        },
        "identification": identification,
        "estimators": ESTIMATORS[method],
        "active_estimator": ESTIMATORS[method][1],
    }
    return build_scenario(raw | changes, "tis paper")


def cell_scenario(cell: Cell, trial: Trial, n_rows: int) -> Scenario:
    """Return a cell's scenario; a given model lets the run begin within the training rows.

    With the reading ``samples`` a delay of d means d sample periods.
    """
    row, scale = cell.row, 1.0 if cell.reading == "ms" else _MS_PER_SAMPLE
    start = 0 if cell.sample == "in sample" else TRAIN_SAMPLES
    forward = {
        "loss": {"kind": "bernoulli", "p_loss": row.loss_pct / 100},
        "delay": {"kind": "uniform", "low_ms": row.low_ms * scale, "high_ms": row.high_ms * scale},
        "jitter": {"kind": "normal", "std_ms": row.jitter_ms * scale},
        "ordering": "reorder",
    }
    base = scenario_of(trial, cell.pairing, cell.method)
    return build_scenario(
        base.model_dump(exclude_none=True)
        | {
            "topology": cell.topology,
            "duration_s": (n_rows - 1 - start) / 30,
            "drain_s": 0,
            "source": base.source.model_dump() | {"start": start},
            "network": {"forward": forward},
            "identification": base.identification.model_dump() | {"train": "given.json"},
        },
        "tis paper",
    )


def run_cell(cell: Cell, trial: Trial, models: bytes) -> dict[str, Any]:
    """Run one cell's twin and return the scores by estimator, names as in summary.json."""
    whole = _recording(trial, cell.pairing)
    scenario = cell_scenario(cell, trial, len(whole))
    start = 0 if cell.sample == "in sample" else TRAIN_SAMPLES
    recording = replace(whole, start=start)
    (model,) = parse_models(models, "given model")
    nodes: dict[Side, Node] = {
        "surgeon": build_surgeon(scenario, recording),
        "netem": build_netem(scenario),
        "patient": build_patient(scenario, [model], recording),
    }
    logs = {side: MemoryLog(side) for side in nodes}
    drive(scenario, nodes, logs)
    run_logs = RunLogs(Path(), {side: log.log for side, log in logs.items()})
    scores = accuracy_of_hand(run_logs, scenario, model.hand, model)
    return {name: one.as_json() for name, one in scores.items()}


@cache
def _recording(trial: Trial, pairing: Pairing) -> Recording:
    """Load a trial, once per process; the pairing selects the arm."""
    return load_recording(scenario_of(trial, pairing))


def run_cells(
    cells: Sequence[Cell],
    trial: Trial,
    models: dict[tuple[Pairing, Method], bytes],
    n_jobs: int | None,
    progress: PhaseProgress,
) -> dict[Cell, dict[str, Any]]:
    """Run all cells in ``n_jobs`` processes (all cores when None); the result does not depend on their number."""
    results: dict[Cell, dict[str, Any]] = {}
    with ProcessPoolExecutor(n_jobs or os.cpu_count(), mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(run_cell, cell, trial, models[cell.pairing, cell.method]): cell for cell in cells}
        pending = set(futures)
        while pending:
            done, pending = wait(pending, _POLL_S, return_when=FIRST_COMPLETED)
            for future in done:
                results[futures[future]] = future.result()
            progress.advance("twins", len(done))
    return {cell: results[cell] for cell in cells}


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
