"""What happens when something dies or is interrupted."""

import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from tests.log_reader import LogReader
from tests.system.conftest import HOLD, Run, RunHere, Start, StartHere, Tis
from tis.common.records import TICKS

pytestmark = pytest.mark.live
SLOW = pytest.mark.slow
PATIENCE_S = 20.0  # what is promised is 3 s on a machine of its own; the runs below are longer
MODULES = {"surgeon": "tis.surgeon_side", "netem": "tis.netem", "patient": "tis.patient_side"}


def gone(pids: list[int], within_s: float) -> bool:
    """Tell whether these processes end within a time."""
    until_s = time.monotonic() + within_s
    while time.monotonic() < until_s:
        if not any(Path(f"/proc/{pid}").exists() for pid in pids):
            return True
        time.sleep(0.02)
    return False


def _last_record_s(tis: Run, side: str) -> float:
    return max(message.log_time for _, message in LogReader(tis.run_dir / f"{side}.mcap").messages()) / 1e9


@pytest.mark.parametrize("side", [pytest.param("surgeon", marks=SLOW), pytest.param("netem", marks=SLOW), "patient"])
def test_a_killed_side_ends_the_run_and_every_log_is_readable(run_here: StartHere, side: str) -> None:
    def kill(run: RunHere) -> None:
        run.await_log("surgeon")
        time.sleep(1.5)
        children = run.children()
        os.kill(run.child(MODULES[side]), signal.SIGKILL)
        assert gone(children, PATIENCE_S)

    tis = run_here("run", "default", "--duration-s", "60", *HOLD, meanwhile=kill)
    code, _, err = tis.wait()
    assert code == 3
    assert f"tis: {side}: killed by SIGKILL" in err
    for other in {"surgeon", "netem", "patient"} - {side}:
        assert f"{side} left during the run" in err, other
    lasts = {name: _last_record_s(tis, name) for name in MODULES}
    assert lasts[side] > max(lasts.values()) - 5.0
    assert LogReader(tis.run_dir / f"{side}.mcap").metadata == {}
    reader = LogReader(tis.run_dir / f"{side}.mcap")
    assert sum(1 for _ in reader.messages()) > 20
    assert reader.damage is not None
    summary = tis.summary()
    assert summary["exit"] == 3
    assert not summary["valid"]


@pytest.mark.parametrize("side", [pytest.param("netem", marks=SLOW), "patient"])
def test_a_killed_side_is_named_where_the_run_goes_on(run_here: StartHere, side: str) -> None:
    def kill(run: RunHere) -> None:
        run.await_log("surgeon")
        os.kill(run.child(MODULES[side]), signal.SIGKILL)

    words = ("--duration-s", "6", *HOLD, "--set", "on_peer_loss=continue")
    tis = run_here("run", "default", *words, meanwhile=kill)
    code, _, err = tis.wait()
    assert code == 3
    assert err.count(f"{side} left, and this side goes on without it") >= 1, err
    if side == "netem":  # its end takes the other side's token along, which has not left
        assert "patient left" not in err
    named = [problem for problem in tis.summary()["problems"] if " left at " in problem]
    assert [problem.split(" ")[0] for problem in named] == [side]


def test_a_sigterm_ends_the_run_in_order(start: Start) -> None:
    """Ctrl-C, beside a live page: `test_view_page`."""
    tis = start("run", "default", "--duration-s", "60", *HOLD)
    tis.await_log("surgeon")
    children = tis.children()
    assert len(children) == len(MODULES)
    tis.process.send_signal(signal.SIGTERM)
    assert gone(children, PATIENCE_S)
    assert_ended_in_order(tis)


def assert_ended_in_order(tis: Tis) -> None:
    """Judge a run that was interrupted: its exit code, what it says, and its logs."""
    code, _, err = tis.wait()
    assert code == 130
    assert "Traceback" not in err
    for side in MODULES:
        reader = LogReader(tis.run_dir / f"{side}.mcap")
        assert any(topic == TICKS or side == "netem" for topic, _ in reader.messages())
        assert reader.damage is None, side
    assert tis.summary()["exit"] == 130


def test_an_interrupt_before_the_run_leaves_nothing_behind(start: Start) -> None:
    tis = start("run", "default")
    until_s = time.monotonic() + PATIENCE_S
    while len(tis.children()) < 3 and time.monotonic() < until_s:
        time.sleep(0.01)
    time.sleep(0.1)
    children = tis.children()
    tis.process.send_signal(signal.SIGINT)
    code, _, err = tis.wait()
    assert code == 130, err
    assert gone(children, PATIENCE_S)


@pytest.mark.parametrize("policy", [pytest.param("continue", marks=SLOW), "end"])
def test_a_lost_run_folder_is_told_when_it_is_lost(run_here: StartHere, policy: str) -> None:
    def lose(run: RunHere) -> None:
        run.await_log("surgeon")
        shutil.rmtree(run.run_dir)

    settings = ("--duration-s", "7", *HOLD, "--set", f"on_log_loss={policy}")
    tis = run_here("run", "default", *settings, meanwhile=lose)
    code, _, err = tis.wait()
    assert code == 4, err
    words = "goes on without it" if policy == "continue" else "ends (on_log_loss)"
    for side in ("surgeon", "patient"):
        assert f"{side}: warning: the log cannot be written any more since " in err
    assert f"the file or its folder was deleted; the run {words}" in " ".join(err.split())
    assert ("5/7 s" in err) == (policy == "continue")
