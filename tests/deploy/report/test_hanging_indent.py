"""A hanging paragraph against the standard library's way to fill one."""

import textwrap
from io import StringIO

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tis.deploy.report.terminal import HangingIndent

WORDS = st.lists(st.text("abc(),0", min_size=1, max_size=8), min_size=1, max_size=30).map(" ".join)


def _shown(text: str, width: int, indent: int = 2) -> list[str]:
    console = Console(file=StringIO(), width=width, color_system=None)
    console.print(HangingIndent(text, "red", indent))
    assert isinstance(console.file, StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


@pytest.mark.parametrize(("width", "indent"), [(30, 4), (80, 2)])
@given(text=WORDS)
def test_its_lines_are_those_of_textwrap(text: str, width: int, indent: int) -> None:
    expected = textwrap.wrap(text, width - indent - 2)
    assert _shown(text, width, indent) == [" " * (indent + 2 * bool(i)) + line for i, line in enumerate(expected)]


def test_square_brackets_are_text() -> None:
    assert _shown("loss [red] 1 %", 40) == ["  loss [red] 1 %"]
