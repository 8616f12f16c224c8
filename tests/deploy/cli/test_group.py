"""The help in sections, and options that would replace themselves."""

import re
from pathlib import Path

import pytest

from tests.deploy.commands import call

_COMMANDS = ("run", "twin", "netem", "compare", "net set", "net fit", "bench netem", "export")


def test_the_help_lists_every_command_once_in_its_section() -> None:
    code, out, _ = call("--help")
    assert code == 0
    headings = [line.rstrip(":") for line in out.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert headings == [
        "Run",
        "Run on several hosts",
        "Look at runs",
        "Scenarios and data",
        "Studies",
        "Networks",
        "One side, on a host of its own",
        "Options",
    ]
    names = [line.split()[0] for line in out.splitlines() if line.startswith("  ") and line[2] not in " -"]
    assert {"run", "twin", "bench", "net", "netem", "report"} < set(names)
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("command", _COMMANDS)
def test_a_description_has_most_of_80_columns(command: str) -> None:
    code, out, _ = call(*command.split(), "--help")
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    assert not re.search(r"<[a-z]", out)
    described = [line for line in out.splitlines() if line.startswith(" " * 20) and line.strip()]
    assert all(len(line) - len(line.lstrip()) <= 32 for line in described)


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("compare", "default", "--seeds", "1", "--seeds", "2"), "--seeds"),
        (("run", "default", "--seed", "1", "--seed=2"), "--seed"),
        (("net", "probe", "-e", "tcp/127.0.0.1:1", "-e", "tcp/127.0.0.1:2"), "-e"),
    ],
)
def test_an_option_that_stands_twice_is_refused(words: tuple[str, ...], option: str, tmp_path: Path) -> None:
    code, _, err = call(*words)
    assert code == 2
    assert option in err
    assert "is given more than once" in err


def test_an_option_of_several_values_may_stand_twice() -> None:
    code, out, _ = call("validate", "default", "--set", "seed=1", "--set", "rate_hz=60")
    assert code == 0
    assert "rate_hz: 60" in out


def test_a_misspelt_scenario_is_recognised() -> None:
    code, _, err = call("validate", "kiloherz")
    assert code == 2
    assert "did you mean 'kilohertz'?" in " ".join(err.split())
