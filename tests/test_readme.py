"""The README's claims that a test can hold: its length, and its sample of a run."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

from tests.deploy.commands import call

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_has_at_most_700_words() -> None:
    assert len(README.split()) <= 700


_TOP = ["README.md", "CONTRIBUTING.md", "DESIGN.md", "SECURITY.md", "SUPPORT.md", "CODE_OF_CONDUCT.md"]


@pytest.mark.parametrize("name", _TOP)
def test_the_files_that_the_top_pages_link_to_exist(name: str) -> None:
    targets = re.findall(r"\]\((?!https?:|#)([^)#]+)", (ROOT / name).read_text(encoding="utf-8"))
    assert [target for target in targets if not (ROOT / target).exists()] == []


def test_version_and_open_fields_are_the_same_wherever_they_stand() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    assert "authors" in project
    assert [author["name"] for author in citation["authors"]] == [author["name"] for author in project["authors"]]


def test_its_sample_is_what_the_twin_prints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    (sample,) = re.findall(r"```text\n(default \(twin.*?)```", README, re.DOTALL)
    code, out, err = call("twin", "default", "--no-report", "--no-merge", "--run-dir", str(tmp_path / "run"))
    assert code == 0, err
    assert out.startswith(sample)
