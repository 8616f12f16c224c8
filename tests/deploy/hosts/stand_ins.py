"""Hosts of this machine on which small programs stand in for the sides."""

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import yaml

SIDES = ("surgeon", "netem", "patient")
SCENARIO = """\
version: 1
name: hosts
duration_s: 5
source: {kind: synthetic}
hosts: {west: tcp/127.0.0.1:7551, east: tcp/127.0.0.1:7552}
"""
_ROOT = Path(__file__).resolve().parents[3]
_TIS = """\
import sys
sys.path.insert(0, {root!r})
sys.executable = {python!r}  # what starts the sides
{before}
from tis.deploy.cli.main import main
main()
"""
_NO_CHECK = """\
from tis.deploy.hosts import agent
agent._faults = lambda request: []
"""
_PYTHON = """\
#!/bin/sh
module=$2
shift 2
exec {python} "{folder}/stand_in_$module.py" "$@"
"""
_MODULES = {"surgeon": "tis.surgeon_side", "netem": "tis.netem", "patient": "tis.patient_side"}
_HEAD = """\
import json, os, pathlib, signal, sys, time
side = {side!r}
run_dir = pathlib.Path(sys.argv[sys.argv.index("--run-dir") + 1])
place = pathlib.Path({folder!r})
with (place / (side + ".pids")).open("a") as file:
    print(os.getpid(), file=file)
n_starts = len((place / (side + ".pids")).read_text().split())
def say(event, **more):
    print(json.dumps(dict(side=side, event=event) | more), flush=True)
def log(text="log", name=None):
    (run_dir / (name or side + ".mcap")).write_text(text)
def interrupted(*_):
    (place / (side + ".interrupted")).touch()
    say("failed", exit_code=130, reasons=["interrupted"])
    sys.exit(130)
signal.signal(signal.SIGINT, interrupted)
"""
RUNS = 'say("running", duration_s=5.0)\nlog()\n'
WAITS = "time.sleep(60)\n"


@dataclass(frozen=True)
class Stage:
    """A folder with a hosts file, a scenario, and the programs."""

    path: Path
    checks: bool = False
    """Whether the hosts look for faults before the run: what they load for it takes longer than all else."""

    @property
    def tis(self) -> str:
        return f"{sys.executable} {self.path / 'command.py'}"

    def write(self, programs: dict[str, str], scenario: str = SCENARIO, **hosts: dict[str, object]) -> Path:
        """Write programs and files; return the hosts file. What is not given of a host is `kind: local`."""
        python, before = self.path / "python", "" if self.checks else _NO_CHECK
        python.write_text(_PYTHON.format(python=sys.executable, folder=self.path))
        python.chmod(0o755)
        (self.path / "command.py").write_text(_TIS.format(root=str(_ROOT), python=str(python), before=before))
        (self.path / "s.yaml").write_text(scenario)
        content: dict[str, object] = {"scenario": "s.yaml"}
        for side in SIDES:
            head = _HEAD.format(side=side, folder=str(self.path))
            (self.path / f"stand_in_{_MODULES[side]}.py").write_text(head + programs.get(side, RUNS))
            (self.path / "work").mkdir(exist_ok=True)
            given = {"kind": "local", "tis": self.tis, "folder": str(self.path / "work")} | hosts.get(side, {})
            content[side] = {key: value for key, value in given.items() if value is not None}
        (self.path / "hosts.yaml").write_text(yaml.safe_dump(content))
        return self.path / "hosts.yaml"

    def pids(self, side: str) -> list[int]:
        """Return the processes that were started for a side, in order."""
        file = self.path / f"{side}.pids"
        return [int(word) for word in file.read_text().split()] if file.exists() else []

    def was_interrupted(self, side: str) -> bool:
        """Tell whether SIGINT reached a process of a side."""
        return (self.path / f"{side}.interrupted").exists()

    def nobody_is_left(self) -> bool:
        return not any(Path(f"/proc/{pid}").exists() for side in SIDES for pid in self.pids(side))


def environment() -> dict[str, str]:
    """Return an environment in which `tis` finds the testbed."""
    return {**os.environ, "PYTHONPATH": str(_ROOT), "COLUMNS": "200"}


def soon(holds: Callable[[], bool], within_s: float = 60.0) -> bool:
    until_s = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.02)
    return True
