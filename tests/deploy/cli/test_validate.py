"""`tis validate` on what stands outside the scenario's file: the traces that its network names, and its rules."""

from pathlib import Path

import pytest

from tests.deploy.commands import call

GOOD = "sent_s,delay_ms\n0,10\n1,12\n"


def _validate(*settings: str) -> tuple[int, str, list[str]]:
    words = [word for setting in settings for word in ("--set", setting)]
    code, out, err = call("validate", "default", *words)
    return code, out, " ".join(err.split()).split("tis: ")[1:]


def _delay(path: Path) -> str:
    return f"network.forward={{delay: {{kind: trace, path: {path}}}}}"


def test_a_trace_that_can_be_read_is_valid(tmp_path: Path) -> None:
    file = tmp_path / "t.csv"
    file.write_text(GOOD)
    code, out, _ = _validate(_delay(file))
    assert code == 0
    assert str(file) in out


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        (None, "does not exist"),
        ("", "sent_s"),
        ("sent_s,delay_ms\n0,-3\n", "delay_ms"),
        ("sent_s,delay_ms\n1,3\n0,3\n", "sent_s"),
    ],
)
def test_a_trace_that_cannot_is_a_line_and_nothing_is_printed(tmp_path: Path, content: str | None, rule: str) -> None:
    file = tmp_path / "t.csv"
    if content is not None:
        file.write_text(content)
    code, out, err = _validate(_delay(file))
    assert (code, out) == (4, "")
    assert len(err) == 1
    assert str(file).replace(" ", "") in err[0].replace(" ", "")
    assert rule in err[0]


def test_all_traces_are_looked_at_wherever_they_stand(tmp_path: Path) -> None:
    """In a loss, in a rule, and in the timeline."""
    names = [tmp_path / f"{name}.csv" for name in "abc"]
    part = "{kind: trace, path: %s}"
    code, _, err = _validate(
        f"network.feedback={{loss: {part % names[0]}}}",
        f"network.rules=[{{key: tis/x, direction: forward, pipeline: {{delay: {part % names[1]}}}}}]",
        f"network.timeline=[{{at_s: 1, set: {{delay: {part % names[2]}}}}}]",
    )
    assert code == 4
    assert len(err) == 3


def test_rules_that_tie_are_refused(tmp_path: Path) -> None:
    rules = ", ".join(f"{{key: {key}, direction: forward, pipeline: {{}}}}" for key in ("tis/*/a", "tis/b/*"))
    code, out, err = _validate(f"network.rules=[{rules}]")
    assert (code, out) == (2, "")
    assert "rules" in err[0]
