"""An output that nobody reads any more ends a command in silence; a full disk does not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

_SAID = """
from tis.deploy.shell.guard import OUT, guarded
import typer
app = typer.Typer()
@app.command()
@guarded
def say(how: str) -> int:
    for k in range(20000):
        OUT.print(k) if how == "rich" else print(k)
    return 0
app()
"""


def _exit_of(how: str, target: int) -> tuple[int, str]:
    root = Path(__file__).resolve().parents[3]
    process = subprocess.run(
        [sys.executable, "-c", _SAID, how],
        stdout=target,
        stderr=subprocess.PIPE,
        text=True,
        cwd=root,
        timeout=120,
        check=False,
    )
    return process.returncode, process.stderr


@pytest.mark.parametrize("how", ["rich", "print"])
def test_a_reader_that_went_away_is_no_error_of_ours(how: str) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    try:
        assert _exit_of(how, write_end) == (1, "")
    finally:
        os.close(write_end)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_an_output_that_cannot_be_written_is_said() -> None:
    with Path("/dev/full").open("w") as full:
        code, err = _exit_of("print", full.fileno())
    assert code != 0
    assert "No space left on device" in err
