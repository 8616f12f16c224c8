"""Validity and fidelity are independent; each has its own sentence."""

from typing import Any

import pytest

from tis.deploy.report.tables.network_tables import fidelity_list
from tis.deploy.report.verdict.verdict_text import fidelity_text, validity_text


def _summary(valid: bool, forward: bool | None, feedback: bool | None) -> dict[str, object]:
    links = {"forward": {"verdict": {"faithful": forward}}, "feedback": {"verdict": {"faithful": feedback}}}
    return {"valid": valid, "links": links}


@pytest.mark.parametrize("forward", [True, None])
def test_a_valid_run_of_the_network_asked_for(forward: bool | None) -> None:
    assert validity_text(_summary(True, forward, True)) == "This run is a valid measurement."


@pytest.mark.parametrize(
    ("forward", "feedback", "named"),
    [(False, True, "(forward)"), (None, False, "(feedback)"), (False, False, "(forward and feedback)")],
)
def test_a_valid_run_of_another_network_says_what_its_figures_hold_for(
    forward: bool | None, feedback: bool | None, named: str
) -> None:
    text = validity_text(_summary(True, forward, feedback))
    assert text.startswith("This run is a valid measurement, but not of the network that the scenario requests")
    assert named in text
    assert text.endswith("its figures hold for the network that there was.")


def test_what_is_not_valid_announces_its_problems_whatever_the_network_was() -> None:
    assert validity_text(_summary(False, False, True)) == "This run is not a valid measurement:"


def test_a_summary_without_verdicts_on_links_has_none_to_speak_of() -> None:
    assert validity_text({"valid": True, "links": {"forward": {}}}) == "This run is a valid measurement."


def test_of_logs_that_were_lost_since_it_says_what_was() -> None:
    text = validity_text(_summary(True, True, True), "netem.mcap was lost")
    assert text == "Before netem.mcap was lost this run was a valid measurement."
    assert "is a valid" not in validity_text(_summary(True, False, True), "netem.mcap was lost")


@pytest.mark.parametrize(
    ("faithful", "undecided", "words"),
    [
        (True, {}, "faithful to the scenario"),
        (
            True,
            {"loss": 450, "what was decided": None},
            "faithful to the scenario in all that could be judged "
            "(loss: not decidable with 450 messages; what was decided: not decidable)",
        ),
        (False, {"loss": 450}, "not faithful to the scenario"),
        (None, {"what was decided": 0}, "not decidable, too little was sent"),
    ],
)
def test_what_could_not_be_judged_stands_beside_faithful(
    faithful: bool | None, undecided: dict[str, int | None], words: str
) -> None:
    assert fidelity_text({"faithful": faithful, "undecided": undecided}, "the scenario") == words


def test_a_summary_without_what_was_left_open_is_read_too() -> None:
    assert fidelity_text({"faithful": True}, "the requested network") == "faithful to the requested network"


def test_without_a_scenario_none_is_named() -> None:
    verdict: dict[str, Any] = {"violations": [], "warnings": [], "not_decidable": [], "undecided": {}}
    for faithful in (True, False, None):
        links = {"forward": {"verdict": verdict | {"faithful": faithful}}}
        assert "that the scenario requests." in fidelity_list(links)
        assert "scenario" not in fidelity_list(links, "was requested")


def test_the_report_s_green_word_has_it_too() -> None:
    verdict = {"faithful": True, "violations": [], "warnings": [], "not_decidable": [], "undecided": {"loss": 450}}
    markup = fidelity_list({"forward": {"verdict": verdict}})
    assert '<strong class="good">faithful in what could be judged</strong>' in markup
    assert ", as far as this run can show (loss: not decidable with 450 messages)." in markup
    assert "as far as" not in fidelity_list({"forward": {"verdict": verdict | {"undecided": {}}}})
