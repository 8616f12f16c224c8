import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.conftest import (
    HOLD,
    RunHere,
    StartHere,
    endpoints,
    is_right_but_for_the_machine,
    model_file,
    run_here,
)

__all__ = ["endpoints", "model_file", "run_here"]

_ROOT = Path(__file__).resolve().parents[3]


def tis(*words: str, **env: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "tis.deploy.cli.main", *words]
    return subprocess.run(
        command, cwd=_ROOT, env={**os.environ, "COLUMNS": "200", **env}, capture_output=True, text=True, timeout=60
    )


def test_a_device_that_is_no_device_is_one_line() -> None:
    done = tis("surgeon", "live", "--device", "theremin")
    assert done.returncode == 2
    assert "--device: must be mouse or gamepad (got 'theremin')" in done.stderr


def test_no_display_is_one_line_and_exit_code_2() -> None:
    pytest.importorskip("pygame")
    done = tis("device", "mouse", SDL_VIDEODRIVER="x11", DISPLAY="")
    assert done.returncode == 2
    assert "needs a display" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_device_needs_a_live_source() -> None:
    done = tis("surgeon", "default", "--device", "mouse", "--connect", "tcp/127.0.0.1:1", SDL_VIDEODRIVER="dummy")
    assert done.returncode == 2
    assert "source.kind: needs a scenario whose source is live (got 'synthetic')" in done.stderr


@pytest.mark.live
def test_the_mouse_is_a_device_in_a_run_and_ends_with_it(
    run_here: StartHere, endpoints: tuple[str, str], model_file: Path
) -> None:
    pytest.importorskip("pygame")
    west, east = endpoints

    def move(_: RunHere) -> None:
        done = tis("device", "mouse", "--connect", west, SDL_VIDEODRIVER="dummy")
        assert done.returncode == 0, done.stderr
        assert "poses sent on device/MTML/measured_cp" in done.stderr

    words = ("--set", f"hosts={{west: {west}, east: {east}}}", "--set", f"identification.train={model_file}")
    run = run_here("run", "live", "--duration-s", "4", *HOLD, *words, meanwhile=move)
    code, _, err = run.wait()
    summary = run.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    assert summary["devices"]["left"]["poses"] > 50
