"""Each answer in words, with what nobody could tell beside it."""

from typing import Any

import pytest

from deploy.report.tables.network_tables import faith_list
from deploy.report.verdict.faithful import faith_in_words


@pytest.mark.parametrize(
    ("faithful", "undecided", "words"),
    [
        (True, {}, "faithful to the scenario"),
        (
            True,
            {"loss": 450, "what was decided": None},
            "faithful to the scenario as far as can be told "
            "(loss: not decidable with 450 messages; what was decided: not decidable)",
        ),
        (False, {"loss": 450}, "not faithful to the scenario"),
        (None, {"what was decided": 0}, "not decidable, too little was sent"),
    ],
)
def test_what_could_not_be_judged_stands_beside_faithful(
    faithful: bool | None, undecided: dict[str, int | None], words: str
) -> None:
    assert faith_in_words({"faithful": faithful, "undecided": undecided}, "the scenario") == words


def test_a_summary_without_what_was_left_open_is_read_too() -> None:
    assert faith_in_words({"faithful": True}, "what was asked") == "faithful to what was asked"


def test_without_a_scenario_none_is_named() -> None:
    verdict: dict[str, Any] = {"violations": [], "warnings": [], "not_decidable": [], "undecided": {}}
    for faithful in (True, False, None):
        links = {"forward": {"verdict": verdict | {"faithful": faithful}}}
        assert "what the scenario asks for." in faith_list(links)
        assert "scenario" not in faith_list(links, "was asked for")


def test_the_report_s_green_word_has_it_too() -> None:
    verdict = {"faithful": True, "violations": [], "warnings": [], "not_decidable": [], "undecided": {"loss": 450}}
    markup = faith_list({"forward": {"verdict": verdict}})
    assert '<strong class="good">faithful as far as can be told</strong>' in markup
    assert "in all that could be judged (loss: not decidable with 450 messages)." in markup
    assert "as far as" not in faith_list({"forward": {"verdict": verdict | {"undecided": {}}}})
