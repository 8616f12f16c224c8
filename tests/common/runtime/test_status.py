"""What a side reports, when others have chosen a part of its text."""

import json

import pytest

from tis.common.runtime.status import Status


@pytest.mark.parametrize("as_events", [False, True])
def test_a_name_or_a_reason_of_others_steers_no_terminal(capsys: pytest.CaptureFixture[str], as_events: bool) -> None:
    status = Status("netem", as_events)
    status.warning("refused \x1b]0;mine\x07\r\nnetem: all is well")
    status.failed(3, ["\x1b[2Jgone", "for ever"])
    said = capsys.readouterr()
    if as_events:
        warning, failed = map(json.loads, said.out.splitlines())
        shown = [warning["warning"], *failed["reasons"]]
    else:
        shown = [line.removeprefix("netem: ").removeprefix("warning: ") for line in said.err.splitlines()]
    assert shown == ["refused ?]0;mine???netem: all is well", "?[2Jgone", "for ever"]


def test_a_way_past_the_emulator_is_a_warning_of_its_own_kind(capsys: pytest.CaptureFixture[str]) -> None:
    Status("netem", as_events=True).bypass("got round")
    assert json.loads(capsys.readouterr().out) == {
        "side": "netem", "event": "warning", "warning": "got round", "kind": "bypass",
    }  # fmt: skip
    Status("netem", as_events=False).bypass("got round")
    assert capsys.readouterr().err == "netem: warning (bypass): got round\n"
