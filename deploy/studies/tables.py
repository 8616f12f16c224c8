"""Tables of the studies: those of a page in Markdown, and those that are committed as JSON in ``docs/studies``."""

import json
import re
from pathlib import Path
from typing import Any, Final

import tis.deploy
from tis.common.errors import DataError, Fault

Table = dict[str, Any]
"""Heading, columns, their alignment, and rows of texts."""

TABLE: Final = re.compile(r"^\|.*\|\n\|[-:| ]+\|\n(?:\|.*\|\n)*", re.MULTILINE)


def committed_folder() -> Path:
    """Return the folder of the committed tables; raises `DataError` outside a clone."""
    folder = Path(tis.deploy.__file__).resolve().parents[1] / "docs" / "studies"
    if not folder.is_dir():
        raise DataError(
            Fault(str(folder), "", "is not here: the committed tables come with a clone, not with a wheel")
        )
    return folder


def committed(name: str) -> list[Table]:
    """Read the tables of a study; raises `DataError`."""
    file = committed_folder() / f"{name}.json"
    try:
        found: list[Table] = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(Fault(str(file), "", f"cannot be read: {error}")) from None
    return found


def tables_in(text: str) -> list[Table]:
    """Return the tables of a page, each under its heading."""
    return [parsed(found[0], heading(text, found.start())) for found in TABLE.finditer(text)]


def parsed(table: str, under: str) -> Table:
    """Return a table in Markdown, which stands under a heading."""
    head, rule, *rows = table.splitlines()
    align = ["right" if cell.endswith(":") else "left" for cell in _cells(rule)]
    return {"heading": under, "columns": _cells(head), "align": align, "rows": [_cells(row) for row in rows]}


def heading(text: str, at: int) -> str:
    """Return the heading that a place of a page stands under."""
    return str(re.findall(r"^#+ (.*)$", text[:at], re.MULTILINE)[-1])


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().removeprefix("|").removesuffix("|").split("|")]


# Pages of the studies: a Markdown file beside the code, with a study's figures and tables in its places.


def filled(template: Path, **parts: object) -> str:
    """Return the text of a template with ``parts`` in the places of their names in braces.

    A part of which nothing is left takes its paragraph with it. The text ends with one newline.
    """
    text = template.read_text(encoding="utf-8").format_map(parts)
    return "\n\n".join(block.strip("\n") for block in text.split("\n\n") if block.strip()) + "\n"
