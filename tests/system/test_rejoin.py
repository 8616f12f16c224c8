"""Sides that are killed and started anew in mid-run: each rejoins, netem too, and one run comes out."""

import json
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import get_args

import pytest

from tests.deploy.commands import call
from tis.common.channels import Side
from tis.common.runtime.ports import free_endpoints

pytestmark = pytest.mark.live
_TIS = [sys.executable, "-m", "tis.deploy.cli.main"]
_SCENARIO = """\
version: 1
name: rejoin
duration_s: 36
on_rejoin: exclude
source: {kind: synthetic}
hosts: {west: WEST, east: EAST}
network: {forward: {delay: {kind: constant, delay_ms: 20}}}
estimators: [hold]
active_estimator: hold
"""


class Sides:
    """The processes of a run in one folder."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._folder = stack, folder
        self.running: dict[Side, subprocess.Popen[bytes]] = {}
        self.said: dict[Side, list[Path]] = {side: [] for side in get_args(Side)}

    def start(self, side: Side) -> None:
        said = self._folder / f"{side}_{len(self.said[side])}.err"
        words = [*_TIS, side, "s.yaml", "--run-dir", "run", "--wait-s", "60"]
        with said.open("wb") as err:
            process = subprocess.Popen(words, cwd=self._folder, stderr=err)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        self.running[side] = process
        self.said[side].append(said)

    def await_word(self, side: Side, word: str, timeout_s: float = 60) -> None:
        until_s = time.monotonic() + timeout_s
        while word not in self.said[side][-1].read_text():
            assert time.monotonic() < until_s, self.texts()
            time.sleep(0.05)

    def kill(self, side: Side) -> None:
        self.running[side].kill()
        self.running[side].wait()

    def texts(self) -> dict[Side, list[str]]:
        return {side: [" ".join(path.read_text().split()) for path in paths] for side, paths in self.said.items()}


def test_each_side_rejoins_its_run_after_a_kill_but_not_after_its_end(tmp_path: Path, without_report: None) -> None:
    west, east = free_endpoints()
    (tmp_path / "s.yaml").write_text(_SCENARIO.replace("WEST", west).replace("EAST", east))
    with ExitStack() as stack:
        sides = Sides(stack, tmp_path)
        for side in get_args(Side):
            sides.start(side)
        for side in get_args(Side):
            sides.await_word(side, "running for")
        code, _, err = call("stop", "a test", "--connect", east)
        assert code == 0, err
        for side in get_args(Side):
            time.sleep(1.5)
            sides.kill(side)
            time.sleep(2.0)  # a shorter silence need not be told
            sides.start(side)
            sides.await_word(side, "back in the run")
        codes = {side: process.wait(timeout=60) for side, process in sides.running.items()}
        texts = sides.texts()
        # a log of a run that is over is not written over, and not continued
        time.sleep(1.5)  # a run may be joined for a second after its end
        sides.start("surgeon")
        assert sides.running["surgeon"].wait(timeout=60) == 4, sides.texts()
        assert "surgeon.mcap: exists, from an earlier run" in sides.texts()["surgeon"][-1]
    assert codes == {"surgeon": 0, "netem": 0, "patient": 0}, texts
    assert "netem is back after" in texts["surgeon"][-1]
    assert "patient is back after" in texts["surgeon"][-1]
    assert "surgeon is back after" in texts["netem"][0]
    call("summarize", str(tmp_path / "run"))
    out = " ".join(call("info", "-v", str(tmp_path / "run"))[1].split())
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert all("too busy" in text or "starved" in text for text in summary["problems"]), summary["problems"]
    for side in get_args(Side):
        log = summary["logs"][side]
        assert (log["state"], len(log["away_s"]), log["away_counts"]) == ("complete", 1, False)
        assert f"{side} was away from" in out
    ticks = summary["ticks"]
    assert ticks["count"] == ticks["planned"] < 36 * 30
    # the patient was stopped, and a crash does not release it
    assert summary["safety"]["left"]["emergency_stops"] == 1
    assert summary["safety"]["left"]["time_s"]["tracking"] < 4
    code, out, _ = call("replay", str(tmp_path / "run"))
    assert (code, "identical" in out) == (0, True), out
