"""What outlives a killed process: the last record of each topic, also when it was killed while it wrote one."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.errors import DataError
from tis.common.messages import decode
from tis.common.node import Record
from tis.common.runtime.arm_memory import ArmMemory, dump_resumed, parse_resumed, remembered
from tis.common.safety_records import STOPS, StopNote

TOPICS = ("tis/PSM2/servo_cp", STOPS)
_KILLED = """
import os, signal, sys
from pathlib import Path
from tis.common.node import Record
from tis.common.runtime.arm_memory import ArmMemory
memory = ArmMemory(Path(sys.argv[1]), ["a", "b"])
for k in range(1001):
    memory.keep(Record("a", k, b"place %d" % k))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_last_records_are_there_after_a_kill(tmp_path: Path) -> None:
    path = tmp_path / "arm.memory"
    root = str(Path(__file__).resolve().parents[3])
    done = subprocess.run(
        [sys.executable, "-c", _KILLED, str(path)], env=os.environ | {"PYTHONPATH": root}, check=False
    )
    assert done.returncode == -signal.SIGKILL
    assert remembered(path, ["a", "b"]) == {"a": b"place 1000"}


def test_each_topic_has_its_own_last_record_and_others_are_passed_over(tmp_path: Path) -> None:
    path, logged = tmp_path / "arm.memory", list[Record]()

    class Log:
        def record(self, record: Record) -> None:
            logged.append(record)

    with ArmMemory(path, TOPICS) as memory:
        recorder = memory.around(Log())
        assert remembered(path, TOPICS) == {}
        for topic, data in ((TOPICS[0], b"one"), (TOPICS[0], b"two"), ("other", b"x"), (TOPICS[0], b"y" * 3000)):
            recorder.record(Record(topic, 1, data))
        recorder.record(Record(STOPS, 1, StopNote(at_ns=1, stop=True, reason="smoke")))
        found = remembered(path, TOPICS)
        memory.forget()
    assert found[TOPICS[0]] == b"two"
    assert decode(found[STOPS], StopNote).reason == "smoke"
    assert len(logged) == 5
    assert remembered(path, TOPICS) == {}
    with ArmMemory(tmp_path / "none", ()) as memory:
        log = Log()
        assert memory.around(log) is log
        memory.keep(Record("a", 1, b"x"))
        memory.forget()
    assert not (tmp_path / "none").exists()


@given(st.integers(0, 2 * 2048 - 1), st.integers(0, 255))
def test_a_byte_that_is_wrong_leaves_the_record_before_or_none(
    tmp_path_factory: pytest.TempPathFactory, at: int, value: int
) -> None:
    path = tmp_path_factory.mktemp("memory") / "arm.memory"
    with ArmMemory(path, ["a"]) as memory:
        memory.keep(Record("a", 1, b"before"))
        memory.keep(Record("a", 2, b"last"))
    content = bytearray(path.read_bytes())
    content[at] = value
    path.write_bytes(content[: max(at, 1)] if value == 0 else content)
    assert remembered(path, ["a"]).get("a") in (b"before", b"last", None)


def test_a_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be written"):
        ArmMemory(tmp_path / "nowhere" / "arm.memory", ["a"])


@given(st.dictionaries(st.text(), st.text().map(str.encode)))
def test_what_a_process_goes_on_after_is_read_back(last: dict[str, bytes]) -> None:
    assert parse_resumed(dump_resumed(last)) == last


@pytest.mark.parametrize("data", [b"", b"[]", b'{"a": 1}', b"\xff", b"[" * 20_000])
def test_what_cannot_be_read_is_nothing(data: bytes) -> None:
    assert parse_resumed(data) == {}


def test_a_stop_is_remembered_whatever_its_reason(tmp_path: Path) -> None:
    for k, letter in enumerate(("x", "\x01", "\U0001f600", '"', "\u2028")):
        path = tmp_path / str(k)
        with ArmMemory(path, [STOPS]) as memory:
            memory.keep(Record(STOPS, 1, StopNote(at_ns=10**18, stop=True, reason=letter * 200)))
            assert decode(remembered(path, [STOPS])[STOPS], StopNote).stop


def test_what_was_left_stays_known_however_often_processes_are_killed(tmp_path: Path) -> None:
    """Three lives: the second and the third are killed before they have anything of their own to keep."""
    path = tmp_path / "arm.memory"
    with ArmMemory(path, TOPICS) as memory:
        memory.keep(Record(STOPS, 1, b"stopped"))
    for _ in range(2):
        last = remembered(path, TOPICS)
        with ArmMemory(path, TOPICS, last) as memory:
            memory.keep(Record(TOPICS[0], 2, b"place"))
    assert remembered(path, TOPICS) == {STOPS: b"stopped", TOPICS[0]: b"place"}
    with ArmMemory(path, TOPICS, remembered(path, TOPICS)) as memory:
        memory.keep(Record(STOPS, 3, b"released"))
    assert remembered(path, TOPICS)[STOPS] == b"released"
