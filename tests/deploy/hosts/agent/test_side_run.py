"""The connection as a host sees it, and events that nobody reads."""

import os
import time
from collections.abc import Iterator

import pytest

from tis.deploy.hosts.agent import side_run
from tis.deploy.hosts.agent.side_run import _Lifeline, _Talk


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = list(os.pipe())
    yield ends[0], ends[1]
    for end in ends:
        try:
            os.close(end)
        except OSError:
            continue


def test_a_side_lives_while_its_connection_talks(pipe: tuple[int, int]) -> None:
    line = _Lifeline(pipe[0])
    assert not line.is_over(0)
    os.write(pipe[1], b"alive\n")
    assert not line.is_over(0)


@pytest.mark.parametrize("said", [b"interrupt\n", b"alive\ninterrupt\n"])
def test_a_request_to_end_is_obeyed_once_and_for_all(pipe: tuple[int, int], said: bytes) -> None:
    line = _Lifeline(pipe[0])
    os.write(pipe[1], said)
    assert line.is_over(1.0)
    os.write(pipe[1], b"alive\n")
    assert line.is_over(0)


def test_the_end_of_the_connection_ends_the_side(pipe: tuple[int, int]) -> None:
    line = _Lifeline(pipe[0])
    os.close(pipe[1])
    assert line.is_over(1.0)


def test_so_does_a_connection_that_is_only_silent(pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    line = _Lifeline(pipe[0])
    assert not line.is_over(0)
    monkeypatch.setattr(side_run, "MAX_SILENCE_S", -1.0)
    assert line.is_over(0)


def test_a_reader_that_stands_still_does_not_hold_up_the_side(
    pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(side_run, "GRACE_S", 0.05)
    talk = _Talk(pipe[1])
    for _ in range(5000):  # more than pipe and queue hold
        talk.pass_on(b"x" * 100 + b"\n")
    assert not talk.has_begun
    talk.pass_on(b'{"side": "netem", "event": "running"}\n')
    assert talk.has_begun
    talk.close()
    os.close(pipe[0])  # its thread ends
    until_s = time.monotonic() + 20
    while not talk.is_broken:
        assert time.monotonic() < until_s
        time.sleep(0.01)
