"""Summary of a logged twin: its numbers by their paths, for figures that a cell's sums do not hold."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tis.common.channels import Side
from tis.common.scenario import Scenario
from tis.common.sources.trajectory import Recording
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.memory import MemoryLog
from tis.deploy.report.summary import build_summary
from tis.deploy.run.twin import build_sides, drive


def summary_of_twin(scenario: Scenario, recording: Recording) -> dict[str, float | None]:
    """Run a twin with logs in memory; return the numbers of its summary.

    Oracle: the figures of a cell's sums, tests/deploy/studies/admissible/test_figures.
    """
    nodes, models, _ = build_sides(scenario, recording=recording)
    memories: dict[Side, MemoryLog] = {side: MemoryLog(side) for side in nodes}
    drive(scenario, nodes, memories)
    logs = RunLogs(Path(), {side: memory.log for side, memory in memories.items()})
    return flat(build_summary(logs, scenario, models, "twin", None, ""))


def flat(tree: Any, path: str = "") -> dict[str, float | None]:
    """Return the numbers of a summary by their dotted paths, truth values as 0 and 1; None is an unknown one."""
    if tree is None or isinstance(tree, bool | int | float):
        return {path: None if tree is None else float(tree)}
    if isinstance(tree, dict):
        items: Iterable[tuple[str, Any]] = ((str(name), below) for name, below in tree.items())
    elif isinstance(tree, list | tuple):
        items = ((str(i), below) for i, below in enumerate(tree))
    else:
        return {}
    return {
        name: value
        for step, below in items
        for name, value in flat(below, f"{path}.{step}" if path else step).items()
    }
