"""The command ``tis`` in the tests' own process: what it prints, and never a traceback."""

from collections.abc import Callable

from typer.testing import CliRunner

from tis.deploy.cli.main import app

Call = Callable[..., tuple[int, str, str]]


def call(*words: str) -> tuple[int, str, str]:
    """Return exit code, output and diagnostics of ``tis`` with these words."""
    result = CliRunner().invoke(app, words)
    assert "Traceback" not in result.output, result.output
    return result.exit_code, result.stdout, result.stderr


def call_in_one_line(*words: str) -> tuple[int, str, str]:
    """Return the same in one line each, whatever the width."""
    code, out, err = call(*words)
    return code, " ".join(out.split()), " ".join(err.split())


def call_by_lines(*words: str) -> tuple[int, list[str], list[str]]:
    """Return the same, line by line."""
    code, out, err = call(*words)
    return code, out.strip().splitlines(), err.strip().splitlines()
