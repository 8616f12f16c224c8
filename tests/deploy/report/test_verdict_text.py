"""Validity and fidelity are independent; each has its own sentence."""

from typing import Any

import pytest

from tests.deploy.report.partial import part, summary_of
from tis.deploy.report.subjects.network.link_figures import LinkVerdict
from tis.deploy.report.subjects.network.link_tables import fidelity_list
from tis.deploy.report.validity import validity_text


def _summary(valid: bool, forward: bool | None, feedback: bool | None) -> Any:
    links = {"forward": {"verdict": {"faithful": forward}}, "feedback": {"verdict": {"faithful": feedback}}}
    return summary_of({"valid": valid, "links": links, "exit": 0, "ticks": {"count": 3, "planned": 3, "rate_hz": 30}})


def _list(links: dict[str, Any], *request: str) -> str:
    return fidelity_list(summary_of({"links": links}).links, *request)


def test_a_drive_that_was_ended_is_valid_for_its_time() -> None:
    ended = {"valid": True, "links": {}, "exit": 130, "duration_s": 41.0, "ticks": {"count": 1230, "planned": 18000}}
    assert "valid measurement of the 41.0 s until Ctrl-C ended it" in validity_text(summary_of(ended))


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
    assert part(LinkVerdict, {"faithful": faithful, "undecided": undecided}).text("the scenario") == words


def test_what_concerns_some_keys_only_names_them_behind_what_was_judged() -> None:
    verdict = {
        "faithful": True, "judged": 713, "keys": 2, "undecided": {"loss": 13}, "undecided_keys": {"loss": "reply"},
        "violations": [], "warnings": [], "not_decidable": [],
    }  # fmt: skip
    words = "judged by 713 messages of 2 keys (loss of reply: not decidable with 13 messages)"
    assert part(LinkVerdict, verdict).text("the scenario") == f"faithful to the scenario, {words}"
    markup = _list({"forward": {"verdict": verdict}})
    assert '<strong class="good">faithful</strong>' in markup
    assert "judged by 713 messages of 2 keys" in markup


@pytest.mark.parametrize("keys", [{}, {"loss": "reply"}])
def test_what_was_judged_is_counted_once_where_the_network_was_changed(keys: dict[str, str]) -> None:
    verdict = {
        "faithful": True, "judged": 713, "set_aside": 287, "keys": 2, "undecided": {"loss": 13},
        "undecided_keys": keys, "violations": [], "warnings": [], "not_decidable": [],
    }  # fmt: skip
    of_keys = " of 2 keys" if keys else ""
    words = f"judged by 713 of 1000 messages{of_keys}, as the network was changed while it ran"
    for text in (part(LinkVerdict, verdict).text("the scenario"), _list({"forward": {"verdict": verdict}})):
        assert words in text
        assert text.count("713") == 1


def test_without_a_scenario_none_is_named() -> None:
    verdict: dict[str, Any] = {"violations": [], "warnings": [], "not_decidable": [], "undecided": {}}
    for faithful in (True, False, None):
        links = {"forward": {"verdict": verdict | {"faithful": faithful}}}
        assert "that the scenario requests." in _list(links)
        assert "scenario" not in _list(links, "was requested")


def test_the_report_s_green_word_has_it_too() -> None:
    verdict = {"faithful": True, "violations": [], "warnings": [], "not_decidable": [], "undecided": {"loss": 450}}
    markup = _list({"forward": {"verdict": verdict}})
    assert '<strong class="good">faithful in what could be judged</strong>' in markup
    assert ", as far as this run can show (loss: not decidable with 450 messages)." in markup
    assert "as far as" not in _list({"forward": {"verdict": verdict | {"undecided": {}}}})
