"""A profile lies beneath what a scenario gives; what is dumped stands alone."""

from collections.abc import Mapping
from typing import Any

import pytest

from tis.common.errors import InputError
from tis.common.scenario.reading import build_scenario, digest, dump_scenario, expand_profile, parse_yaml

MINIMAL: dict[str, Any] = {"version": 1, "name": "a", "source": {"kind": "synthetic"}}
LINK: dict[str, Any] = {
    "from_profile": "link",
    "forward": {
        "loss": {"kind": "bernoulli", "p_loss": 0.1},
        "delay": {"kind": "uniform", "low_ms": 5, "high_ms": 9},
        "correlation": {"half_life_s": 2},
    },
    "feedback": {"delay": {"kind": "constant", "delay_ms": 4}},
    "outages": [{"kind": "periodic", "every_s": 10, "for_s": 1}],
}


def library(name: str) -> Mapping[str, Any]:
    if name != "link":
        raise LookupError("must be link")
    return LINK


def expanded(network: Any) -> Any:
    return expand_profile(MINIMAL | {"network": network}, "s.yaml", library)["network"]


def test_alone_it_is_the_profile_and_says_so() -> None:
    assert expanded({"profile": "link"}) == LINK


def test_a_stage_given_replaces_the_profiles_stage_and_null_removes_it() -> None:
    given = {"delay": {"kind": "constant", "delay_ms": 1}, "correlation": None, "ordering": "reorder"}
    assert expanded({"profile": "link", "forward": given})["forward"] == {
        "loss": LINK["forward"]["loss"],
        "delay": {"kind": "constant", "delay_ms": 1},
        "ordering": "reorder",
    }


def test_lists_are_replaced_whole_and_null_takes_them_away() -> None:
    other = {"kind": "periodic", "every_s": 5, "for_s": 1}
    assert expanded({"profile": "link", "outages": [other]})["outages"] == [other]
    assert "outages" not in expanded({"profile": "link", "outages": None})
    assert "feedback" not in expanded({"profile": "link", "feedback": None})


def test_what_is_not_about_the_profile_stays() -> None:
    network = expanded({"profile": "link", "unmatched": "pass", "buffer": {"max_packets": 5}})
    assert (network["unmatched"], network["buffer"]) == ("pass", {"max_packets": 5})


@pytest.mark.parametrize("network", ["x", None, 3, [], {"profile": 3}, {"profile": None}, {"profile": ["link"]}])
def test_what_is_no_network_is_left_to_the_validation(network: Any) -> None:
    assert expanded(network) == network


def test_nothing_given_is_changed() -> None:
    raw = MINIMAL | {"network": {"profile": "link", "forward": {"loss": None}}}
    before = repr(raw), repr(LINK)
    expand_profile(raw, "s.yaml", library)
    assert (repr(raw), repr(LINK)) == before


def test_a_dumped_scenario_stands_alone() -> None:
    scenario = build_scenario(MINIMAL | {"network": {"profile": "link"}}, "s.yaml", library)
    assert scenario.network.from_profile == "link"
    assert scenario.network.forward.loss is not None
    assert build_scenario(parse_yaml(dump_scenario(scenario), "again"), "again") == scenario


def test_the_name_of_a_profile_is_not_part_of_what_is_agreed_on() -> None:
    by_name = build_scenario(MINIMAL | {"network": {"profile": "link"}}, "s.yaml", library)
    by_value = build_scenario(
        MINIMAL | {"network": {key: value for key, value in LINK.items() if key != "from_profile"}}, "s.yaml"
    )
    other = build_scenario(MINIMAL | {"network": {"profile": "link", "outages": None}}, "s.yaml", library)
    assert digest(by_name) == digest(by_value) != digest(other)


def test_an_unknown_profile_is_named() -> None:
    with pytest.raises(InputError) as caught:
        build_scenario(MINIMAL | {"network": {"profile": "lnk"}}, "s.yaml", library)
    assert str(caught.value) == "s.yaml: network.profile: must be link (got 'lnk')"


def test_without_a_library_a_profile_is_refused_with_a_way_out() -> None:
    with pytest.raises(InputError) as caught:
        build_scenario(MINIMAL | {"network": {"profile": "link"}}, "s.yaml")
    assert str(caught.value).startswith("s.yaml: network.profile: must have been replaced by its values")
    assert "tis validate" in str(caught.value)
