"""A side's view of who has left, which the loop asks for at every turn."""

import pytest

from tis.common.runtime.control import Presence
from tis.common.runtime.meeting import Meeting, new_meeting
from tis.common.runtime.process import Interrupt
from tis.common.scenario import reading
from tis.deploy.run.resolve import resolve


def _a_meeting() -> Meeting:
    return new_meeting(resolve("default", (), None, 5.0), "surgeon", ("west",), Interrupt(), lambda: None)


def test_netem_is_named_first_and_ones_own_side_and_strangers_are_not() -> None:
    meeting = _a_meeting()
    own = meeting.digest
    meeting.rosters["west"].left += [
        Presence("patient", own, mirrored=True),
        Presence("netem", own, mirrored=False),
        Presence("surgeon", own, mirrored=True),
    ]
    assert meeting.lost() == ["netem", "patient"]
    meeting = _a_meeting()
    meeting.rosters["west"].left.append(Presence("patient", "0" * 16, mirrored=True))
    assert meeting.lost() == []


def test_the_loop_does_not_compute_the_scenarios_digest_again(monkeypatch: pytest.MonkeyPatch) -> None:
    meeting = _a_meeting()

    def again(_: object) -> str:
        raise AssertionError("computed again")

    monkeypatch.setattr(reading, "digest", again)
    assert meeting.lost() == []
    meeting.check_scenarios()
