"""The line of a field, for the faults of a file."""

import pytest

from tis.common.yaml_text import line_of

TEXT = """version: 1
network:
  forward: &link
    delay: {kind: constant,
            delay_ms: -3}
  feedback: *link
  outages:
    - {kind: poisson}
    - {kind: fixed,
       p: 2}
"""


@pytest.mark.parametrize(
    ("field", "line"),
    [
        ("version", 1),
        ("network.forward.delay.delay_ms", 5),
        ("network.feedback.delay.delay_ms", 5),
        ("network.outages.1.p", 10),
        ("network.outages.1.missing", 9),
        ("network.outages.7", 7),
        ("network.jitter", 2),
        ("seed", None),
        ("", None),
    ],
)
def test_a_field_or_what_it_would_stand_in_has_its_line(field: str, line: int | None) -> None:
    assert line_of(TEXT, field) == line


@pytest.mark.parametrize("text", ["", "3", "[1, 2]", "a"])
def test_a_text_without_keys_has_none(text: str) -> None:
    assert line_of(text, "a.b") is None
