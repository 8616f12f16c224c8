"""A profile accounts for every number; what is missing, double or of nothing is named, all at once."""

from typing import Any

import pytest
from pydantic import ValidationError

from tis.common.scenario.faults import faults
from tis.common.scenario.profile import Profile, numeric_paths

NETWORK: dict[str, Any] = {
    "forward": {"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 2}},
    "feedback": {"delay": {"kind": "constant", "delay_ms": 3}},
}
GOOD: dict[str, Any] = {
    "name": "a_link",
    "title": "A link",
    "sources": {"paper": "A paper, 2020"},
    "network": NETWORK,
    "numbers": [{"of": "*.delay", "source": "paper", "basis": "measured"}],
}


def found(**changes: Any) -> list[str]:
    with pytest.raises(ValidationError) as caught:
        Profile.model_validate(GOOD | changes)
    return [str(fault).removeprefix("p.yaml: ") for fault in faults(caught.value, Profile, "p.yaml")]


def number(of: str, **changes: Any) -> dict[str, Any]:
    return {"of": of, "source": "paper", "basis": "measured"} | changes


def test_a_profile_keeps_what_its_file_gives_and_no_defaults() -> None:
    assert Profile.model_validate(GOOD).partial() == NETWORK


def test_every_number_is_found_by_its_path() -> None:
    tree = {"a": [{"b": 1, "c": "x"}, 2.5], "d": True, "e": {"f": None, "g": -1}}
    assert list(numeric_paths(tree)) == [("a", "0", "b"), ("a", "1"), ("e", "g")]


def test_a_number_without_a_source_is_refused() -> None:
    assert found(numbers=[number("forward.delay")]) == [
        "numbers must have an entry for network.feedback.delay.delay_ms"
    ]


def test_a_number_with_two_sources_is_refused() -> None:
    assert found(numbers=[number("*.delay"), number("forward.delay.low_ms")]) == [
        "numbers must cover network.forward.delay.low_ms once, not by *.delay and forward.delay.low_ms"
    ]


@pytest.mark.parametrize(
    ("changes", "rules"),
    [
        ({"sources": {}}, ["sources: must have at least 1 item"]),
        (
            {"numbers": [number("*.delay", source="book")]},
            [
                "numbers.source must be one of sources (paper), not book",
                "sources must be used: no number refers to paper",
            ],
        ),
        (
            {"numbers": [number("*.delay", basis="guess")]},
            ["numbers.0.basis: must be 'measured', 'fitted' or 'judgement' (got 'guess')"],
        ),
        (
            {"numbers": [number("*.delay"), number("forward.loss")]},
            ["numbers.of must be a path of numbers in network, not forward.loss"],
        ),
        (
            {"numbers": [number("*.delay"), number("delay..x")]},
            ["numbers.1.of: must be a path like forward.delay.points or *.loss.p_loss (got 'delay..x')"],
        ),
        ({"fnord": 1, "title": ""}, ["title: must have at least 1 character (got '')", "fnord: unknown key (got 1)"]),
        ({"network": {"forwards": {}}}, ["network.forwards: unknown key, did you mean 'forward'? (got {})"]),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, Any], rules: list[str]) -> None:
    assert found(**changes) == rules


def test_descending_points_are_refused_in_the_words_of_the_model() -> None:
    points = [{"p": 0, "delay_ms": 5}, {"p": 0.5, "delay_ms": 4}, {"p": 1, "delay_ms": 9}]
    network = {"forward": {"delay": {"kind": "quantiles", "points": points}}}
    assert found(network=network) == [
        "network.forward.delay: points must have strictly ascending p and no descending delay_ms"
    ]


@pytest.mark.parametrize("reference", [{"profile": "b"}, {"from_profile": "b"}])
def test_a_profile_refers_to_no_other(reference: dict[str, str]) -> None:
    (rule,) = found(network=NETWORK | reference)
    assert "must" in rule


def test_a_step_of_a_path_is_not_its_beginning() -> None:
    """forward.delay does not cover forward.delay_more: steps are compared, not letters."""
    assert found(numbers=[number("*.del")]) == [
        "numbers must have an entry for network.forward.delay.low_ms",
        "numbers must have an entry for network.forward.delay.high_ms",
        "numbers must have an entry for network.feedback.delay.delay_ms",
        "numbers.of must be a path of numbers in network, not *.del",
    ]
