"""Measured tables of the studies: JSON in ``docs/studies``, which the build puts into the studies' pages.

A study's command writes a whole page. `python docs/from_code/study_tables.py PAGE...` then moves its tables into
``docs/studies/NAME.json``, and the commands of its sections into ``docs/studies/NAME.sh``, and leaves a link to each.
"""

import json
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from tis.deploy.studies.tables import TABLE, Table, committed, heading, parsed

DOCS: Final = Path(__file__).resolve().parents[1]
_COMMAND: Final = re.compile(r"^```\n((?:\w+=\S+ )?tis .{100,})\n```\n", re.MULTILINE)
"""A command longer than a line; a short one stays on its page."""
_LINK: Final = re.compile(r"^\[table (\d+)\]\([./]*studies/(\w+)\.json\)\n", re.MULTILINE)


def taken_out(text: str, name: str) -> tuple[str, list[Table]]:
    """Return a page with a link in place of each table, and the tables, each under its heading."""
    tables: list[Table] = []

    def link(found: re.Match[str]) -> str:
        tables.append(parsed(found[0], heading(text, found.start())))
        return f"[table {len(tables)}](../studies/{name}.json)\n"

    return TABLE.sub(link, text), tables


def commands_out(text: str, name: str) -> tuple[str, str]:
    """Return a page with a link in place of each command, and a shell file of the commands under their headings."""
    script = "\n".join(f"# {heading(text, found.start())}\n{found[1]}\n" for found in _COMMAND.finditer(text))
    return _COMMAND.sub(f"[The command](../studies/{name}.sh)\n", text), script


def put_in(text: str, tables_of: Callable[[str], Sequence[Table]]) -> str:
    """Return a page with the tables in place of the links to them."""
    return _LINK.sub(lambda found: _markdown(tables_of(found[2])[int(found[1]) - 1]), text)


tables_of = committed


def as_json(tables: Sequence[Table]) -> str:
    """Return the file of a study: a line for each row, so that differences can be read."""
    parts = []
    for table in tables:
        head = [f'  "{name}": {_line(table[name])},' for name in ("heading", "columns", "align")]
        rows = ",\n".join(f"    {_line(row)}" for row in table["rows"])
        parts.append("\n".join([" {", *head, '  "rows": [', rows, "  ]", " }"]))
    return "[\n" + ",\n".join(parts) + "\n]\n"


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _markdown(table: Table) -> str:
    rule = ["---:" if each == "right" else "---" for each in table["align"]]
    lines = [f"| {' | '.join(table['columns'])} |", f"|{'|'.join(rule)}|"]
    lines += [f"| {' | '.join(row)} |" for row in table["rows"]]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for page in map(Path, sys.argv[1:]):
        text, tables = taken_out(page.read_text(encoding="utf-8"), page.stem)
        text, script = commands_out(text, page.stem)
        (DOCS / "studies" / f"{page.stem}.json").write_text(as_json(tables), encoding="utf-8")
        if script:
            (DOCS / "studies" / f"{page.stem}.sh").write_text(script, encoding="utf-8")
        page.write_text(text, encoding="utf-8")
