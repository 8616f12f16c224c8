"""A terminal that goes away, as ssh's does, and `kill -9`: what they leave of netem's folder."""

import json
import os
import pty
import select
import signal
import sys
import time
from pathlib import Path

import pytest
import yaml

from tests.common.runtime.live_zenoh import a_client, soon
from tests.deploy.commands import call
from tests.log_reader import LogReader
from tests.system.conftest import Start
from tis.common.errors import DataError
from tis.common.records import FATES

pytestmark = pytest.mark.live

_ROOT = Path(__file__).resolve().parents[2]
_ASKED_S = 30.0


def _read_until(terminal: int, words: bytes) -> None:
    heard, until_s = b"", time.monotonic() + _ASKED_S
    while words not in heard:
        assert time.monotonic() < until_s, heard
        if select.select((terminal,), (), (), 0.1)[0]:
            heard += os.read(terminal, 1 << 16)


def _tells_of_fates(log: Path) -> bool:
    """Tell whether there are several batches: of its last moment a log that was cut may not tell all."""
    try:
        return sum(topic == FATES for topic, _ in LogReader(log).messages()) > 3
    except DataError:  # its head is not written yet
        return False


def test_netem_closes_its_folder_when_its_terminal_goes_away(tmp_path: Path, endpoints: tuple[str, str]) -> None:
    west, east = endpoints
    command = [sys.executable, "-m", "tis.deploy.cli.main", "netem", "demo/**", "--west", west, "--east", east]
    pid, terminal = pty.fork()
    if pid == 0:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup ignores it, and a child inherits that
        os.chdir(_ROOT)
        os.execv(sys.executable, [*command, "--run-dir", str(tmp_path / "run")])
    try:
        _read_until(terminal, b"Ctrl-C ends it")
    finally:
        os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names == {"netem.mcap", "network.yaml", "manifest.json", "audit.jsonl"}
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["exit_codes"] == {"netem": 0}
    reader = LogReader(tmp_path / "run" / "netem.mcap")
    assert any(True for _ in reader.messages())
    assert reader.damage is None


def test_a_killed_netem_leaves_its_network_and_a_log_that_can_be_recovered(
    start: Start, endpoints: tuple[str, str]
) -> None:
    west, east = endpoints
    tis = start("netem", "demo/**", "--west", west, "--east", east, "--set", "forward.delay.delay_ms=5")
    log = tis.run_dir / "netem.mcap"
    with a_client(west) as here:
        assert soon(lambda: (tis.run_dir / "network.yaml").exists())
        assert soon(lambda: here.put("demo/pose", b"1") or _tells_of_fates(log))
        tis.process.send_signal(signal.SIGKILL)
        assert tis.wait()[0] == -signal.SIGKILL
    network = yaml.safe_load((tis.run_dir / "network.yaml").read_text())
    assert network == {"forward": {"delay": {"kind": "constant", "delay_ms": 5.0}}}
    code, out, _ = call("recover", str(log))
    assert code == 3
    assert "tis summarize" in " ".join(out.split())
    assert call("summarize", str(tis.run_dir))[0] == 5
    summary = tis.summary()
    assert summary["links"]["forward"]["offered"] > 0
    assert "was recovered from a damaged one" in summary["problems"][0]
    assert (tis.run_dir / "manifest.json").exists()


def test_ctrl_c_while_a_network_is_waited_for_is_130_and_leaves_no_folder(
    start: Start, endpoints: tuple[str, str]
) -> None:
    west, east = endpoints
    tis = start("netem", "--west", west, "--connect-east", east)
    assert tis.process.stderr is not None
    assert "waiting for the east network" in tis.process.stderr.readline()
    tis.process.send_signal(signal.SIGINT)
    assert tis.wait()[0] == 130
    assert not tis.run_dir.exists()
