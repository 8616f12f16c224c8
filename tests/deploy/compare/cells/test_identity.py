"""The digests cover every module of `tis.deploy` that computes a result, late imports included."""

import ast
from pathlib import Path

import tis
from tis.deploy.compare.cells import identity

ROOT = Path(tis.__file__).parent


def reached_from(module: str) -> set[str]:
    """Return the files of modules in `tis.deploy` that this one imports anywhere, and so on, itself included."""
    found, new = set[str](), [module]
    while new:
        place = new.pop().replace(".", "/").removeprefix("tis/")
        file = ROOT / f"{place}.py"
        # what only shows a result does not decide it
        if not place.startswith("deploy/") or place.startswith("deploy/present/"):
            continue
        if not file.is_file() or f"{place}.py" in found:
            continue
        found.add(f"{place}.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                new += [node.module, *(f"{node.module}.{each.name}" for each in node.names)]
            elif isinstance(node, ast.Import):
                new += [each.name for each in node.names]
    return found


def test_all_that_computes_a_cell_or_its_summary_decides_a_digest() -> None:
    covered = identity._imported(identity._CELL) | identity._imported(identity._SUMMARY)
    reached = reached_from("tis.deploy.compare.cells.cell")
    assert "deploy/report/summarise.py" in reached
    assert reached <= covered
