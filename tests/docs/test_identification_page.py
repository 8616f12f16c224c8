"""The worked example of the page on identification runs, and finds what the page says."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "research" / "identification.md"


def test_its_example_keeps_the_integrators_and_predicts(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, float] = {}
    exec(compile(code, str(PAGE), "exec"), names)
    assert capsys.readouterr().out.startswith("order 2 of errors")
    assert 0 < names["error"] < 0.1
