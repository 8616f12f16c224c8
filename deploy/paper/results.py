"""Results behind `docs/paper.md`: axes of its tables and computed values of their cells."""

from dataclasses import dataclass
from typing import Any, Final

from tis.deploy.paper.cells import Cell, Method, Pairing, Sample, Topology, Trial
from tis.deploy.paper.printed import ROWS, PaperRow
from tis.deploy.paper.simulation import Reading, Simulated
from tis.patient_side.statespace import ArmModel

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
