"""The log in memory against the log in a file: the same run gives the same columns and the same summary."""

from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from tis.common.channels import Direction
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.logs.read.packets import link_fates, link_releases
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, drive, run_twin


@pytest.mark.slow
def test_a_twin_in_memory_is_the_twin_in_files(tmp_path: Path) -> None:
    scenario = resolve("lossy", (), None, 4.0)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, tmp_path)
    from_files = load_run(tmp_path)

    again, _, _ = build_sides(scenario)
    memories = {side: MemoryLog(side) for side in again}
    drive(scenario, again, memories)
    in_memory = RunLogs(tmp_path, {side: memory.log for side, memory in memories.items()})

    for side, log in from_files.sides.items():
        assert in_memory.sides[side].rows == log.rows
        assert in_memory.sides[side].messages.keys() == log.messages.keys()
        for key, columns in log.messages.items():
            for name in ("seq", "sent_ns", "log_ns", "sample_ns", "command_sample_ns"):
                assert np.array_equal(getattr(in_memory.sides[side].messages[key], name), getattr(columns, name))
        assert (in_memory.sides[side].n_messages, in_memory.sides[side].last_ns) == (log.n_messages, log.last_ns)
    for direction in get_args(Direction):
        for ours, theirs in zip(_books(in_memory, direction), _books(from_files, direction), strict=True):
            assert len(theirs) > 0
            assert ours == theirs
    summaries = [build_summary(logs, scenario, models, "twin", 0, "") for logs in (from_files, in_memory)]
    assert summaries[0] == summaries[1]


def _books(logs: RunLogs, direction: Direction) -> list[list[Any]]:
    frames = link_fates(logs, direction), link_releases(logs, direction)
    return [list(frame.column(name)) for frame in frames for name in frame.names]
