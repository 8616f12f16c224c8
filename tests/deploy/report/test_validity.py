"""What the sides noticed of each other, as problems of a run."""

from pathlib import Path
from typing import Any

import pytest
from msgspec import to_builtins

from tests.deploy.report.partial import causes, part, summary_of
from tis.common.channels import Side
from tis.common.device_records import FOREIGN_SURGEON
from tis.common.peer_life import Event
from tis.common.records import COUNTERS, PEERS, PeerNote
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import SideLog
from tis.deploy.report import validity
from tis.deploy.report.section import Statistics
from tis.deploy.report.subjects.devices import DeviceFigures, silent_programs
from tis.deploy.report.subjects.latency import Latency, sent_after_arrival


def _logs(*notes: tuple[Side, float, Side, Event, float, str]) -> RunLogs:
    logs = RunLogs(Path("run"))
    for side in ("surgeon", "netem", "patient"):
        logs.sides[side] = SideLog(side)
    for by, at_s, peer, event, for_s, doing in notes:
        note = PeerNote(
            at_ns=round(at_s * NS_PER_S), peer=peer, event=event, for_ns=round(for_s * NS_PER_S), doing=doing
        )
        logs.sides[by].add_rows(PEERS, [to_builtins(note)])
    return logs


def test_what_several_sides_noticed_is_one_problem_of_the_side_that_knows_best() -> None:
    logs = _logs(
        ("netem", 5.0, "patient", "frozen", 1.0, ""),
        ("surgeon", 5.4, "patient", "frozen", 1.4, ""),
        ("patient", 6.9, "patient", "frozen", 3.0, ""),
        ("netem", 7.0, "patient", "back", 3.0, ""),
    )
    assert causes(validity._lives(logs)) == ["patient stood still (3.0 s) at 5.0 s, as it itself noticed"]


def test_a_link_that_is_down_is_a_better_reason_than_a_silence() -> None:
    logs = _logs(("surgeon", 5.0, "patient", "silent", 1.0, ""), ("netem", 5.2, "patient", "link_down", 1.2, ""))
    assert causes(validity._lives(logs)) == [
        "patient could not be reached: nothing crossed the network between the hosts at 5.0 s, as netem noticed"
    ]


def test_what_happens_later_is_another_problem() -> None:
    logs = _logs(
        ("netem", 5.0, "patient", "frozen", 1.0, ""),
        ("netem", 20.0, "patient", "stalled", 1.2, "mine:Slow"),
        ("netem", 30.0, "surgeon", "left", 0.2, ""),
    )
    assert causes(validity._lives(logs)) == [
        "patient stood still (1.0 s) at 5.0 s, as netem noticed",
        "patient did not tick: its loop stayed in one step (mine:Slow) at 20.0 s, as netem noticed",
        "surgeon left at 30.0 s, as netem noticed",
    ]


def test_missed_ticks_have_the_cause_that_is_known() -> None:
    stepped = validity._why_missed(_logs(("patient", 9.0, "patient", "clock_step", 10.0, "")), "patient")
    assert stepped == ("as its clock stepped", "let chrony slew the clock instead")
    why, _ = validity._why_missed(_logs(("netem", 9.0, "patient", "stalled", 2.0, "x")), "patient")
    assert why == "as its loop stayed in one step"
    assert validity._why_missed(_logs(), "patient")[0].startswith("the machine is too busy")


def test_a_log_that_lacks_records_is_a_problem_and_the_topics_are_named() -> None:
    logs = _logs()
    for name, n in (("unrecorded./tis/plant", 3), ("unrecorded./tis/estimates/hold", 40), ("received", 9)):
        logs.sides["patient"].add_rows(COUNTERS, [{"name": name, "value": n}])
    assert causes(validity._unrecorded(logs)) == [
        "patient's log lacks 43 records, written too slowly: 40 of /tis/estimates/hold, 3 of /tis/plant"
    ]


def _summary(**parts: Any) -> Any:
    link = {"sent": 720, "unplanned_loss": 0}
    nothing = {"links": {"forward": link}, "latency_ms": {}, "rejected": {"surgeon": 0, "patient": 0}}
    return summary_of(nothing | {"quarantined": {}, "accuracy": {"hold": {"n_scored": 99}}} | parts)


def test_messages_that_were_not_used_are_named_as_the_cause() -> None:
    unused = {"rejected": {"surgeon": 9, "patient": 720}, "quarantined": {"ahead": 8, "place": 0, "number": None}}
    lost, unscored = (
        {"links": {"forward": {"sent": 720, "unplanned_loss": 8}}},
        {"accuracy": {"hold": {"n_scored": 0}}},
    )
    assert validity._unused(_summary(**unused)) == []  # a stranger's: the stream is whole
    assert validity._unused(_summary(**lost)) == []
    assert validity._unused(_summary(**lost, rejected={"patient": 7}, quarantined={"ahead": 7})) == []
    assert validity._unused(_summary(**unused, **lost)) == validity._unused(_summary(**unused, **unscored))
    gated = {"links": {"forward": {"sent": 720, "unplanned_loss": 0, "not_used": 8}}}
    [quarantined] = causes(validity._unused(_summary(**gated, quarantined={"ahead": 8})))
    assert quarantined == "quarantined: the patient did not use 8 samples (8 stamped later than now)"
    assert causes(validity._unused(_summary(**unused, **lost))) == [
        "rejected: the patient rejected 720 messages: no header of the testbed, another run's number, or no such "
        "pose",
        "quarantined: the patient did not use 8 samples (8 stamped later than now)",
    ]


def test_samples_that_were_refused_as_their_unit_is_wrong_name_the_likely_one() -> None:
    lost = {"links": {"forward": {"sent": 720, "unplanned_loss": 700}}, "quarantined": {"place": 700}}
    warnings = ["T: PSM2 moves over 200 m, further than any arm: are these millimetres?"]
    [text] = validity._unused(_summary(**lost, recording={"warnings": warnings}), "table")
    assert "set source.units.position: mm" in text
    assert "(700 out of the arm's reach)" in text
    assert "patient.gate.reach_m" in text  # a drone moves so far
    [text] = validity._unused(_summary(**lost), "table")
    assert "raise patient.gate.reach_m" in text


def test_a_program_of_which_no_pose_was_used_is_a_problem() -> None:
    used, unused = (part(DeviceFigures, {"poses": n, "refused": {"jump": 1 - n}}) for n in (1, 0))
    assert causes(silent_programs({"left": unused, "right": used}, {"left": unused})) == [
        "devices.left: no pose came from the device that could be used",
        "external_arms.left: no pose came from the external arm that could be used",
    ]
    silent = part(DeviceFigures, {"poses": 0, "refused": {"jump": 0}})
    assert causes(silent_programs({"left": silent}, {"left": silent})) == [
        "devices.left: nobody moved the hand: no pose came",
        "external_arms.left: no pose came from the external arm",
    ]
    assert silent_programs({}, {}) == []


@pytest.mark.parametrize(("network_ms", "bound_ms"), [(None, None), (3.0, None), (-0.9, None), (-3.9, 3.0)])
def test_a_send_time_within_what_clocks_know_is_no_problem(network_ms: float | None, bound_ms: float | None) -> None:
    latency = part(Latency, {"network": {"p50": network_ms}})
    bounds: dict[str, Statistics] = {} if bound_ms is None else {"latency_ms.network": {"p50": bound_ms}}
    assert sent_after_arrival(latency, bounds) == []


def test_messages_sent_after_their_arrival_are_a_problem() -> None:
    assert causes(sent_after_arrival(part(Latency, {"network": {"p50": -999.4}}), {})) == [
        "latency_ms.network: by their headers (sent_ns) messages were sent after they had arrived, median 999.4 ms"
    ]


def test_ticks_of_a_foreign_surgeon_are_not_the_machines_fault() -> None:
    logs = _logs()
    logs.sides["surgeon"].add_rows(COUNTERS, [{"name": FOREIGN_SURGEON, "value": 1}])
    assert validity._why_missed(logs, "surgeon")[0].startswith("as the foreign surgeon sent no such sample")
    assert validity._why_missed(logs, "patient")[0].startswith("the machine is too busy")
