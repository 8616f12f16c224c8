"""netem's batches as columns: in their order, by key; and a log of another version is no traceback."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.deploy.report.hand_made import ARM, COMMAND, MS, fate, release, write_log, write_run
from tis.common.errors import DataError
from tis.common.messages import Message
from tis.common.node import Record
from tis.common.records import FATES, RELEASES
from tis.deploy.logs.read.load import load_run
from tis.deploy.logs.read.packets import by_key, link_fates, link_releases
from tis.deploy.logs.read.side_log import DEPARTURES, OUTCOMES


def test_batches_become_columns_in_their_order(tmp_path: Path) -> None:
    netem = [
        fate(COMMAND, 3, 1, 20, copies=2, flipped=5, n_bytes=77),
        fate(ARM, 9, 2, None, "queue_full", foreign=True),
        fate(COMMAND, 4, 3, 10),
        fate(COMMAND, 0, 4, 10, direction="feedback"),
        release(COMMAND, 4, 3, 13, 13.5, copy_index=1, queued_ms=2),
        release(ARM, 1, 3, 13, 14, departure="evicted"),
    ]
    logs = write_run(tmp_path, netem=netem)
    fates, releases = link_fates(logs, "forward"), link_releases(logs, "forward")
    assert fates.keys == (COMMAND, ARM)
    assert fates.key.tolist() == [0, 0, 1]
    assert fates.foreign.tolist() == [False, False, True]
    assert fates.seq.tolist() == [3, 4, 9]
    assert (fates.offered_ns // MS).tolist() == [1, 3, 2]
    assert [OUTCOMES[code] for code in fates.outcome] == ["deliver", "deliver", "queue_full"]
    assert (fates.delay_ns // MS).tolist() == [20, 10, 0]
    assert (fates.release_ns // MS).tolist() == [21, 13, 0]
    assert fates.n_bytes.tolist() == [77, 100, 100]
    assert (fates.copies.tolist(), fates.flipped.tolist()) == ([2, 0, 0], [5, 0, 0])
    assert releases.keys == (COMMAND, ARM)
    assert releases.copy_index.tolist() == [1, 0]
    assert (releases.released_ns / MS).tolist() == [13.5, 0]
    assert [DEPARTURES[code] for code in releases.departure] == ["released", "evicted"]
    assert (releases.queued_ns // MS).tolist() == [2, 0]
    assert link_fates(logs, "feedback").seq.tolist() == [0]
    some = fates.at(fates.key == 0)
    assert (some.keys, some.seq.tolist()) == (fates.keys, [3, 4])


def test_without_a_log_there_is_nothing(tmp_path: Path) -> None:
    logs = load_run(tmp_path)
    for frame, n_columns in ((link_fates(logs, "forward"), 11), (link_releases(logs, "feedback"), 10)):
        assert [len(frame.column(name)) for name in frame.names] == [0] * n_columns


class _Old(Message, frozen=True):
    direction: str = "forward"
    key: str = COMMAND
    foreign: bool = False
    seq: int = 4


class _Torn(_Old, frozen=True):
    seq: tuple[int, ...] = (1, 2)  # type: ignore[assignment]
    offered_ns: tuple[int, ...] = (1,)
    outcome: tuple[str, ...] = ("deliver",)
    delay_ns: tuple[int, ...] = (1,)
    release_ns: tuple[int, ...] = (1,)
    n_bytes: tuple[int, ...] = (1,)
    copies: tuple[int, ...] = (1,)
    flipped: tuple[int, ...] = (1,)


@pytest.mark.parametrize(
    "data", [_Old(), _Torn(), _Torn(seq=(1,), outcome=("swallowed",)), _Torn(seq=(1,), delay_ns=(2**70,))]
)
def test_a_log_of_another_version_is_refused_by_name_and_topic(tmp_path: Path, data: Message) -> None:
    for topic in (FATES, RELEASES):
        write_log(tmp_path, "netem", [Record(topic, 0, data)])
        with pytest.raises(DataError, match=rf"netem\.mcap: {topic}: holds"):
            load_run(tmp_path)


@given(st.lists(st.integers(0, 4), max_size=30))
def test_places_by_key_are_those_of_a_loop(index: list[int]) -> None:
    found = by_key(np.array(index, dtype=np.int64), 5)
    assert [places.tolist() for places in found] == [[i for i, k in enumerate(index) if k == key] for key in range(5)]
