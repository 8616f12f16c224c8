"""The product's source: short functions, one import name."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("common", "surgeon_side", "netem", "patient_side", "deploy")
MAX_LINES = 60
LONG_BY_NATURE = {
    "netem/bridge/command.py: netem_command": "it holds the next",
    "netem/bridge/command.py: command": "typer reads one parameter per option off the signature",
}


def product_files() -> Iterator[Path]:
    return (file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py")))


def functions(file: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def test_no_function_is_longer_than_a_screen() -> None:
    long = {
        f"{file.relative_to(ROOT)}: {function.name}": n_lines
        for file in product_files()
        for function in functions(file)
        if (n_lines := (function.end_lineno or 0) - function.lineno + 1) > MAX_LINES
    }
    assert {name: n for name, n in long.items() if name not in LONG_BY_NATURE} == {}


def test_nothing_imports_a_folder_by_its_name_at_the_top_level() -> None:
    """Each class would exist twice."""
    names = "|".join(PACKAGES)
    old = re.compile(rf"^\W*(from ({names})[.\w]* import\b|import ({names})\b)")
    found = []
    for folder in (*PACKAGES, "tis", "tests", "docs", "examples"):
        for file in sorted((ROOT / folder).rglob("*")):
            if file.suffix in (".py", ".md", ".ipynb", ".sh") and "_build" not in file.parts:
                lines = file.read_text(encoding="utf-8").splitlines()
                found += [f"{file.relative_to(ROOT)}: {line}" for line in lines if old.search(line)]
    assert found == []
