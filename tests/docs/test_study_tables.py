"""The studies' tables: nothing is lost on the way from a page to JSON and back, and every link has its table."""

import re

import pytest

from from_code.study_tables import DOCS, as_json, commands_out, put_in, tables_of, taken_out

PAGE = """# A study

## Delay

tis compare --page

| estimator | 33 | 100 |
|---|---:|---:|
| hold | 1.000 | 1.000 (0.98-1.02) |
| `paper` | 59.4 |  |

## Loss

| what | share |
|---|---|
| lost | 0.10 |
"""
STUDIES = sorted(path.stem for path in (DOCS / "studies").glob("*.json"))
PAGES = [page for page in DOCS.glob("*/*.md") if "/studies/" in page.read_text(encoding="utf-8")]


def test_tables_go_to_json_and_come_back() -> None:
    text, tables = taken_out(PAGE, "mine")
    assert re.findall(r"^\[table.*", text, re.MULTILINE) == [
        "[table 1](../studies/mine.json)",
        "[table 2](../studies/mine.json)",
    ]
    assert [table["heading"] for table in tables] == ["Delay", "Loss"]
    assert tables[0]["rows"][1] == ["`paper`", "59.4", ""]
    assert put_in(text, {"mine": tables}.__getitem__) == PAGE


def test_long_commands_go_to_a_shell_file_under_their_headings() -> None:
    delay, loss = (f"tis compare {name} --estimators {'hold,' * 30}" for name in ("delay", "loss"))
    page = f"## Delay\n\nWhy.\n\n```\n{delay}\n```\n\n## Loss\n\n```\nA=b {loss}\n```\n\n```\ntis paper\n```\n"
    text, script = commands_out(page, "mine")
    link = "[The command](../studies/mine.sh)"
    assert text == f"## Delay\n\nWhy.\n\n{link}\n\n## Loss\n\n{link}\n\n```\ntis paper\n```\n"
    assert script == f"# Delay\n{delay}\n\n# Loss\nA=b {loss}\n"
    assert commands_out(text, "mine") == (text, "")


@pytest.mark.parametrize("name", STUDIES)
def test_every_table_of_a_study_is_on_its_page_once(name: str) -> None:
    (page,) = (page for page in PAGES if page.stem == name)
    text = page.read_text(encoding="utf-8")
    numbers = [int(number) for number in re.findall(rf"^\[table (\d+)\]\(\.\./studies/{name}\.json\)$", text, re.M)]
    assert numbers == list(range(1, len(tables_of(name)) + 1))
    again = taken_out(put_in(text, tables_of), name)
    assert again == (text, tables_of(name))
    assert as_json(again[1]) == (DOCS / "studies" / f"{name}.json").read_text(encoding="utf-8")
