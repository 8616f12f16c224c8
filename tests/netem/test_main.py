"""The emulator of a scenario, as a process of its own."""

import pytest

from tis.common.errors import InputError, PeerError
from tis.common.runtime.clock import monotonic_ns
from tis.common.runtime.control import Epoch, boot_digest
from tis.common.runtime.meeting import Meeting, new_meeting
from tis.common.runtime.process import Interrupt
from tis.common.runtime.side_log import SideOptions
from tis.common.runtime.status import Status
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.common.scenario.reading import build_scenario
from tis.netem.__main__ import _join, run_netem

S = 1_000_000_000


@pytest.mark.parametrize("endpoints", [["tcp/127.0.0.1:0"], ["tcp/127.0.0.1:0"] * 3])
def test_other_than_two_places_to_listen_are_a_mistake_of_the_user(
    endpoints: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    scenario = build_scenario({"version": 1, "name": "s", "source": {"kind": "synthetic"}}, "s.yaml")
    run_dir = tmp_path_factory.mktemp("netem") / "run"
    options = SideOptions(run_dir, ZenohOptions(listen=endpoints))
    with pytest.raises(InputError, match="--listen: must be given twice, west first, then east"):
        run_netem(scenario, options, Status("netem", as_events=False))
    assert not run_dir.exists()


def _meeting(surgeons: Epoch | None, patients: Epoch | None) -> Meeting:
    document = {"version": 1, "name": "s", "duration_s": 20, "source": {"kind": "synthetic"}}
    meeting = new_meeting(build_scenario(document, "s"), "netem", ("west", "east"), Interrupt(), lambda: None)
    if surgeons is not None:
        meeting.rosters["west"].epochs["surgeon"] = surgeons
    if patients is not None:
        meeting.rosters["east"].epochs["patient"] = patients
    return meeting


def test_netem_begins_a_run_where_no_side_is_in_one() -> None:
    before_ns = monotonic_ns()
    found = _join(_meeting(None, None))
    assert found.epoch.epoch_ns == found.clock.epoch_ns > before_ns
    assert (found.epoch.boot, found.joined_ns) == (boot_digest(), None)


def test_netem_goes_on_with_the_run_that_a_side_is_in() -> None:
    epoch = Epoch(monotonic_ns() - 5 * S, 77, boot_digest())
    for meeting in (_meeting(epoch, None), _meeting(None, epoch), _meeting(epoch, epoch)):
        found = _join(meeting)
        assert (found.epoch, found.clock.epoch_ns) == (epoch, epoch.epoch_ns)
        assert found.joined_ns is not None
        assert found.joined_ns >= 5 * S


def test_a_side_is_believed_on_its_own_network_only() -> None:
    meeting = _meeting(None, None)
    meeting.rosters["west"].epochs["patient"] = Epoch(monotonic_ns() - 5 * S, 77, boot_digest())
    assert _join(meeting).joined_ns is None


def test_runs_that_netem_cannot_go_on_with_are_refused_by_reason() -> None:
    now_ns = monotonic_ns()
    one, other = Epoch(now_ns - 5 * S, 77, boot_digest()), Epoch(now_ns - 4 * S, 78, boot_digest())
    with pytest.raises(PeerError, match="surgeon and patient are in different runs"):
        _join(_meeting(one, other))
    with pytest.raises(PeerError, match="it began on another host, or before a restart of this one"):
        _join(_meeting(one._replace(boot="0" * 16), None))
    with pytest.raises(PeerError, match="the run of the sides is over"):
        _join(_meeting(one._replace(epoch_ns=now_ns - 30 * S), None))
