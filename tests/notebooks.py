"""Notebooks of the manual: their content, and what their code makes when it runs, cell by cell."""

import json
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[1] / "docs"


def notebook(name: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((DOCS / name).read_text(encoding="utf-8"))
    return content


def executed(name: str) -> dict[str, Any]:
    """Return the names that the code defines."""
    names: dict[str, Any] = {}
    for cell in notebook(name)["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{name}, {cell['id']}", "exec"), names)
    return names


def check_form(name: str) -> None:
    """Assert that a notebook has the form of version 4.5 and no outputs."""
    content = notebook(name)
    assert (content["nbformat"], content["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in content["cells"]]
    assert len(set(ids)) == len(ids)
    for cell in content["cells"]:
        assert cell["cell_type"] in ("markdown", "code")
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
