"""Pages of the manual that list what the code or the project declares."""

import re
import tomllib
from typing import Final

from tests.test_source import ROOT
from tis.deploy.shell.shipped_scenarios import shipped_names

TESTBED: Final = ROOT / "docs" / "testbed"


def test_each_shipped_scenario_is_named() -> None:
    page = (TESTBED / "change_scenario.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+)`", page)) | {
        f"paper_{k}" for k in range(1, 7) if "`paper_1` to `paper_6`" in page
    }
    assert set(shipped_names()) <= named


def test_each_extra_is_named_and_exists() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    page = (TESTBED / "install.md").read_text(encoding="utf-8")
    heads = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", page, re.MULTILINE)
    assert {name for head in heads for name in re.findall(r"\w+", head)} == set(project["optional-dependencies"])
