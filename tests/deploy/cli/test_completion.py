"""What a shell completes."""

from pathlib import Path

import pytest
from typer.main import get_command

from tis.deploy.cli import completion
from tis.deploy.cli.main import app


def test_scenarios_and_profiles_are_names_and_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loss.yaml").write_text("")
    (tmp_path / "lots").mkdir()
    (tmp_path / "lots" / "a.yml").write_text("")
    (tmp_path / "lost.txt").write_text("")
    assert completion.scenarios("lo") == ["lossy", "loss.yaml", "lots/"]
    assert completion.scenarios("lots/") == ["lots/a.yml"]
    assert completion.profiles("hosp") == ["hospital_wifi"]


def test_a_list_of_estimators_goes_on_with_those_that_it_lacks() -> None:
    assert completion.estimators("hold,innov") == ["hold,innovations_kf"]
    assert "hold" in completion.estimators("")
    assert "hold,hold" not in completion.estimators("hold,h")


def test_the_options_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    command = get_command(app).commands["compare"]  # type: ignore[attr-defined]
    parameters = {one.name: one for one in command.params}
    context = command.make_context("compare", ["default"], resilient_parsing=True)
    words = {name: [one.value for one in parameters[name].shell_complete(context, given)]
             for name, given in (("scenario", "defa"), ("estimators", "hold,arx"))}  # fmt: skip
    assert words == {"scenario": ["default"], "estimators": ["hold,arx_kf"]}


@pytest.mark.parametrize(
    ("command", "words", "parameter", "given", "found"),
    [
        ("patient", ["default"], "scenario", "defa", "default"),
        ("surgeon", ["default"], "scenario", "defa", "default"),
        ("netem", [], "words", "defa", "default"),
        ("netem", [], "network", "defa", "default"),
        ("netem", [], "profile", "hosp", "hospital_wifi"),
    ],
)
def test_single_sides_complete(command: str, words: list[str], parameter: str, given: str, found: str) -> None:
    side = get_command(app).commands[command]  # type: ignore[attr-defined]
    context = side.make_context(command, words, resilient_parsing=True)
    one = {each.name: each for each in side.params}[parameter]
    assert [each.value for each in one.shell_complete(context, given)] == [found]
