"""A new scenario is valid as it is, names its schema, and replaces nothing."""

import json
from pathlib import Path

import pytest
import yaml

from tests.deploy.commands import call
from tis.common.scenario.reading import build_scenario


def test_a_new_scenario_is_valid_commented_and_has_its_schema_beside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _ = call("new", "my_network")
    assert code == 0
    assert "tis run my_network.yaml" in out
    text = Path("my_network.yaml").read_text()
    scenario = build_scenario(yaml.safe_load(text), "my_network.yaml")
    assert scenario.name == "my_network"
    assert text.splitlines()[0] == "# yaml-language-server: $schema=scenario.schema.json"
    schema = json.loads(Path("scenario.schema.json").read_text())
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["$id"] == "urn:tis:scenario:1"
    assert set(yaml.safe_load(text)) <= set(schema["properties"])
    assert call("validate", "my_network.yaml")[0] == 0


def test_a_file_that_exists_stays_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text("mine")
    code, _, err = call("new", "mine")
    assert code == 2
    assert "mine.yaml: exists already and is not replaced" in " ".join(err.split())
    assert Path("mine.yaml").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"]


@pytest.mark.parametrize("name", ["-x y", "nowhere/mine", "a b", "\u00e4"])
def test_a_name_that_is_none_and_a_folder_that_is_not_there_are_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert call("new", "--", name)[0] == 2
    assert list(tmp_path.iterdir()) == []


def test_a_shipped_name_is_refused_and_a_file_left_out_of_a_name_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = call("new", "default")
    assert code == 2
    assert "must not be a shipped scenario's, which `tis run default` runs (got 'default')" in " ".join(err.split())
    assert not list(tmp_path.iterdir())
    assert call("new", "mine")[0] == 0
    for name in ("mine", "mine.yml"):
        assert "did you mean 'mine.yaml'?" in " ".join(call("validate", name)[2].split())
