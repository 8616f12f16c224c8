"""Every command, option, profile, scenario and estimator that a template, a help or a hint names exists."""

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from tests.test_source import product_files
from tis.common.scenario.estimator_names import fault_of as estimator_fault
from tis.common.scenario.reading import build_scenario
from tis.deploy.cli.main import app
from tis.deploy.net.profiles import profile_path
from tis.deploy.net.profiles import shipped_names as profiles
from tis.deploy.shell.shipped_scenarios import SHIPPED, shipped_names

ROOT = Path(__file__).parents[3]
TEMPLATES = [ROOT / "deploy/tools/new_scenario.yaml", *sorted(SHIPPED.glob("*.yaml"))]
TIS = typer.main.get_command(app)
_QUOTED = re.compile(r"`tis ([^`]+)`")
_IN_HELP = re.compile(r"(?:: |`|^ *)tis ([^`:;\n]+)", re.MULTILINE)
_OF_SCENARIO = ("run", "twin", "validate", "compare", "identify", "admissible", "surgeon", "patient")


def commands(command: Any = TIS, path: str = "tis") -> Iterator[tuple[str, Any]]:
    """Every command with its path, groups included."""
    yield path, command
    for name, below in getattr(command, "commands", {}).items():
        yield from commands(below, f"{path} {name}")


def helps() -> Iterator[tuple[str, str]]:
    """Every text of a help, with the command it belongs to."""
    for path, command in commands():
        yield path, command.help or ""
        for option in command.params:
            yield path, getattr(option, "help", None) or ""


LEAVES = [(path, one) for path, one in commands() if not hasattr(one, "commands") and not one.hidden]


@pytest.mark.parametrize(("path", "command"), LEAVES, ids=[path for path, _ in LEAVES])
def test_the_help_of_a_command_ends_with_an_example_of_it(path: str, command: Any) -> None:
    example = command.epilog.replace("\\\n", "")
    assert example.startswith(path)
    assert fault_of(example.removeprefix("tis ")) is None
    assert max(map(len, command.epilog.splitlines())) <= 78


def strings() -> Iterator[tuple[str, str]]:
    """Every text in the code of the product, f-strings in their parts."""
    for file in product_files():
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield str(file.relative_to(ROOT)), node.value


def fault_of(line: str) -> str | None:
    """Return what of a command line does not exist."""
    here: Any = TIS
    words = line.split()
    while words and hasattr(here, "commands") and not words[0].startswith("-"):
        name = words.pop(0)
        for one in name.split("|"):
            if one not in here.commands:
                return f"no command {one}"
        here = here.commands[name.split("|")[0]]
    options = {name for one in here.params for name in (*one.opts, *one.secondary_opts)}
    for word in words:
        option = word.partition("=")[0].strip(".,()")
        if re.fullmatch(r"--[a-z][a-z-]+", option) and option not in options | {"--help"}:
            return f"no option {option}"
    for before, word in zip(["", *words], words, strict=False):
        if before == "--profile" and word[0].islower() and word not in profiles():
            return f"no profile {word}"
    first = words[0] if words else ""
    if here.name in _OF_SCENARIO and re.fullmatch(r"[a-z][a-z0-9_]+", first) and first not in shipped_names():
        return f"no scenario {first}"
    return None


@pytest.mark.parametrize("file", TEMPLATES, ids=lambda file: file.stem)
def test_what_a_template_names_exists(file: Path) -> None:
    text = file.read_text()
    for name in re.findall(r"\bprofile: *([a-z0-9_]+)", text):
        profile_path(name)
    for line in _QUOTED.findall(text.replace("FILE", "file.yaml")):
        assert fault_of(line) is None, line
    given = yaml.safe_load(text)
    assert [name for name in given.get("estimators", ()) if estimator_fault(name)] == []
    if "profile" not in given.get("network", {}):
        build_scenario(given, file.name)


@pytest.mark.parametrize("texts", [helps, strings], ids=["help", "code"])
def test_what_a_help_or_a_hint_names_exists(texts: Callable[[], Iterator[tuple[str, str]]]) -> None:
    pattern = _IN_HELP if texts is helps else _QUOTED
    found = {f"{where}: tis {line}: {fault}" for where, text in texts() for line in pattern.findall(text)
             if (fault := fault_of(line))}  # fmt: skip
    assert found == set()
