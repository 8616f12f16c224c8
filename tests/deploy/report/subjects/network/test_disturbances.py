"""Planned and live outages and changes of a run in virtual time, at instants that are known."""

import json
from pathlib import Path

import pytest

from tis.common.records import ControlNote
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.subjects.network.disturbances import Disturbance, disturbances, disturbances_text
from tis.deploy.report.summarise import summary_of
from tis.deploy.report.terminal import brief
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.netem.control.replay import weightiest

_TIMELINE = (
    "network.timeline=[{at_s: 0.5, for_s: 0.25, direction: both, set: {outage: true}}, "
    "{at_s: 3.5, for_s: 0.2, direction: forward, set: {stall: true}}]"
)
SCENARIO = resolve("default", ["estimators=[hold]", "active_estimator=hold", _TIMELINE], None, 4.0)


def _note(at_s: float, for_s: float, direction: str, change: dict[str, object]) -> ControlNote:
    entry = {"at_s": at_s, "for_s": for_s, "direction": direction, "set": change}
    at_ns = round(at_s * 1e9)
    return ControlNote(
        at_ns=at_ns - 500_000, applied_ns=at_ns, request="{}", added=json.dumps([entry]), accepted=True
    )


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> RunLogs:
    notes = [
        _note(1.5, 0.5, "both", {"outage": True}),
        _note(2.5, 0.75, "forward", {"delay": {"kind": "constant", "delay_ms": 90}}),
    ]
    run_dir = tmp_path_factory.mktemp("run")
    nodes, models, _ = build_sides(SCENARIO, notes)
    run_twin(SCENARIO, nodes, models, run_dir)
    return load_run(run_dir)


def test_each_is_found_once_with_its_time_direction_and_cause(logs: RunLogs) -> None:
    planned, outage, change, stall = disturbances(logs, SCENARIO)
    assert planned == Disturbance(0.5, 0.75, "outage", "both", live=False)
    assert outage == Disturbance(1.5, 2.0, "outage", "both", live=True)
    assert change == Disturbance(2.5, 3.25, "change", "forward", live=True, what="delay 90 ms")
    assert stall == Disturbance(3.5, 3.7, "stall", "forward", live=False)


def test_in_words_the_live_ones_come_first(logs: RunLogs) -> None:
    assert disturbances_text("mine", disturbances(logs, SCENARIO)) == (
        "Somebody changed the network of mine while it ran: outage of 0.5 s at 1.50 s, both directions; "
        "from 2.50 s for 0.75 s, forward: delay 90 ms. mine had 1 planned outage, 0.25 s in all. "
        "mine had 1 planned stall, 0.2 s in all."
    )
    assert disturbances_text("calm", []) == ""
    lasting = Disturbance(2.5, 308.5, "change", "both", live=True, what="delay 90 ms", lasts=True)
    assert str(lasting) == "from 2.50 s to the end, both directions: delay 90 ms"


def test_the_summary_says_what_was_changed_and_how_many_messages_are_judged(logs: RunLogs) -> None:
    summary = summary_of(MeasuredRun.of(logs, SCENARIO, []), "live", 0, "tis run")
    assert summary.changes == [
        "both directions, from 1.500 s for 0.5 s: outage",
        "forward, from 2.500 s for 0.75 s: delay 90 ms",
    ]
    verdict = summary.links["forward"].verdict
    assert 0 < verdict.set_aside < verdict.judged
    assert verdict.judged + verdict.set_aside == summary.links["forward"].offered
    text = " ".join(brief(summary, [], 80).plain.split())
    assert f"judged by {verdict.judged} of {summary.links['forward'].offered} messages" in text
    assert "2 times while it ran" in text
    assert "delay 90 ms" in text


def test_many_are_counted() -> None:
    found = [Disturbance(float(k), k + 0.5, "outage", "forward", live=True) for k in range(5)]
    assert disturbances_text("mine", found).endswith("at 2.00 s, forward; and 2 more.")


def test_the_weightiest_are_named_in_order_of_time() -> None:
    changes = [Disturbance(float(k), k + 0.5 + k % 2, "change", "both", live=True, what=f"no {k}") for k in range(5)]
    outage = Disturbance(5.0, 5.1, "outage", "both", live=True)
    absent = Disturbance(6.0, 7.0, "absence", "both", True, "patient")
    text = disturbances_text("mine", [*changes, outage, absent])
    assert [f"no {k}" in text for k in range(5)] == [False, True, False, True, False]
    assert text.index("no 3") < text.index("outage of 0.1 s at 5.00 s, both directions; and 3 more.")
    assert "absence of 1 s at 6.00 s, patient." in text
    many = [absent._replace(begin_s=float(k), end_s=k + 1.0) for k in range(5)]
    assert disturbances_text("mine", many).endswith("and 2 more.")


def test_of_many_changes_in_words_an_outage_is_kept() -> None:
    changes = [f"forward, from {k}.000 s: delay {k} ms" for k in range(5)]
    outage = "both directions, from 9.000 s for 0.5 s: outage"
    assert weightiest([*changes, outage], 3) == [*changes[:2], outage]
    assert weightiest(changes[:2], 3) == changes[:2]


def test_without_netems_log_nothing_is_known(tmp_path: Path) -> None:
    assert disturbances(RunLogs(tmp_path), SCENARIO) == []
