"""What both sides sent, compared with their logs."""

from pathlib import Path

import pytest

from tis.common.messages import Wrench, encode
from tis.common.node import Record
from tis.common.runtime.mcap_log import McapLog
from tis.common.vector import ZERO, as_message
from tis.deploy.run.replay import Forces, compare_forces

KEY = "tis/PSM2/measured_cf"


def _sent(k: int) -> Record:
    t_ns = 1_000_000 * k
    wrench = Wrench(
        sample_ns=t_ns,
        tick=k,
        force_n=as_message(ZERO),
        energy_j=None,
        wave=None,
        active=True,
        command_sample_ns=None,
    )
    return Record(KEY, t_ns, encode(wrench), Wrench, t_ns, k)


@pytest.mark.parametrize(("logged", "n_absent"), [(range(3), 0), (range(4), 0), (range(5), 1), (range(2), 1)])
def test_only_what_was_sent_in_the_tick_of_a_kill_may_be_in_one_only(
    tmp_path: Path, logged: range, n_absent: int
) -> None:
    """Ticks 0 to 2 ended, and the side was killed in tick 3."""
    path, replayed = tmp_path / "patient.mcap", Forces()
    with McapLog(path, {"side": "patient"}) as log:
        for k in logged:
            log.record(_sent(k))
    for k in range(3):
        replayed.record(_sent(k))
    replayed.killed_after([{"tick": k} for k in range(3)])
    assert compare_forces([((path,), replayed)]) == (min(len(logged), 3), 0, n_absent)
