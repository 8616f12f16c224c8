"""Valid and faithful are two questions: what is said of each of the four answers."""

import pytest

from deploy.report.verdict.validity import validity


def _summary(valid: bool, forward: bool | None, feedback: bool | None) -> dict[str, object]:
    links = {"forward": {"verdict": {"faithful": forward}}, "feedback": {"verdict": {"faithful": feedback}}}
    return {"valid": valid, "links": links}


@pytest.mark.parametrize("forward", [True, None])
def test_a_valid_run_of_the_network_asked_for(forward: bool | None) -> None:
    assert validity(_summary(True, forward, True)) == "This run is a valid measurement."


@pytest.mark.parametrize(
    ("forward", "feedback", "named"),
    [(False, True, "(forward)"), (None, False, "(feedback)"), (False, False, "(forward and feedback)")],
)
def test_a_valid_run_of_another_network_says_what_its_figures_hold_for(
    forward: bool | None, feedback: bool | None, named: str
) -> None:
    text = validity(_summary(True, forward, feedback))
    assert text.startswith("This run is a valid measurement, but not of the network that the scenario asks for")
    assert named in text
    assert text.endswith("its figures hold for the network that there was.")


def test_what_is_not_valid_announces_its_problems_whatever_the_network_was() -> None:
    assert validity(_summary(False, False, True)) == "This run is not a valid measurement:"


def test_a_summary_without_verdicts_on_links_has_none_to_speak_of() -> None:
    assert validity({"valid": True, "links": {"forward": {}}}) == "This run is a valid measurement."


def test_of_logs_that_were_lost_since_it_says_what_was() -> None:
    text = validity(_summary(True, True, True), "netem.mcap was lost")
    assert text == "Before netem.mcap was lost this run was a valid measurement."
    assert "is a valid" not in validity(_summary(True, False, True), "netem.mcap was lost")
