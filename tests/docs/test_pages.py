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


def test_each_link_of_a_clone_leads_to_a_file() -> None:
    """Pages that are made with the site are linked by `docs/reference/index.md`, which says what tells the same."""
    made = re.compile(r"docs/reference/(?!index|protocol)|docs/testbed/in_python|docs/studies/_")
    dead = []
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").glob("[!_]*/*.md"), *(ROOT / "docs").glob("*.md")]:
        if made.match(str(page.relative_to(ROOT))):
            continue
        for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            target = (page.parent / link).resolve()
            if "://" not in link and (not target.exists() or made.match(str(target.relative_to(ROOT)))):
                dead.append(f"{page.relative_to(ROOT)}: {link}")
    assert dead == []
