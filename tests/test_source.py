"""The product's source: short functions, docstrings that begin with what a thing is, test names of one line."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("common", "surgeon_side", "netem", "patient_side", "deploy")
MAX_LINES = 60
MAX_TEST_NAME = 80
QUESTION = re.compile(r"(What|How|Where|Whether|Who|Whose|Why|Which|When)\b")
LONG_BY_NATURE = {
    "netem/bridge/command.py: netem_command": "typer reads one parameter per option off the signature",
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


@pytest.mark.parametrize("package", PACKAGES)
def test_modules_open_with_a_noun_phrase(package: str) -> None:
    asked = []
    for file in sorted((ROOT / package).rglob("*.py")):
        text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8")))
        assert text, f"{file}: no docstring"
        if QUESTION.match(text):
            asked.append(str(file.relative_to(ROOT)))
    assert asked == []


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


def test_names_of_tests_fit_on_a_line() -> None:
    names = {
        f.name for file in (ROOT / "tests").rglob("test_*.py") for f in functions(file) if f.name.startswith("test_")
    }
    assert {name for name in names if len(name) > MAX_TEST_NAME} == set()
