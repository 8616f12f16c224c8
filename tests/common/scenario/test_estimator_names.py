"""Names of estimators as text: what is accepted, what is said of the rest, and what topics have for them."""

import keyword
import re
from string import ascii_letters, digits
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.errors import InputError
from tis.common.estimators import ESTIMATORS, NAMES
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import each_once, fault_of, is_built_in, is_user_defined, plain_name
from tis.common.scenario.reading import build_scenario, digest, dump_scenario, parse_yaml

RAW: dict[str, Any] = {"version": 1, "name": "s", "source": {"kind": "synthetic"}}
WORDS = st.builds(  # [A-Za-z][A-Za-z0-9_]{0,8}; from_regex takes ten times as long
    str.__add__, st.sampled_from(ascii_letters), st.text(ascii_letters + digits + "_", max_size=8)
).filter(lambda word: not keyword.iskeyword(word))
OWN = st.builds(
    lambda module, factory: f"{'.'.join(module)}:{'.'.join(factory)}",
    st.lists(WORDS, min_size=1, max_size=3),
    st.lists(WORDS, min_size=1, max_size=2),
)


def faults(**changes: Any) -> list[str]:
    with pytest.raises(InputError) as caught:
        build_scenario({**RAW, **changes}, "s")
    return [str(fault) for fault in caught.value.faults]


@settings(max_examples=50)
@given(OWN)
def test_what_python_can_import_is_a_name_and_legal_in_topics_and_columns(name: str) -> None:
    assert fault_of(name) is None
    assert is_user_defined(name)
    assert not is_built_in(name)
    assert re.fullmatch("[A-Za-z0-9_]+", plain_name(name))
    assert plain_name(name) not in NAMES


def test_the_testbeds_own_names_are_as_they_are_everywhere() -> None:
    assert [plain_name(name) for name in NAMES] == list(NAMES)
    assert all(is_built_in(name) and not is_user_defined(name) and fault_of(name) is None for name in NAMES)


@pytest.mark.parametrize("name", ["adaptive_kf", "tis.patient_side.estimators:adaptive_kf"])
def test_a_former_name_says_which_does_its_work_now(name: str) -> None:
    assert "innovations_kf" in (fault_of(name) or "")


@pytest.mark.parametrize(
    "name",
    [
        "a:",
        ":b",
        "a:b:c",
        "a b:c",
        "a-b:c",
        "_a:b",
        "a..b:c",
        "a.:b",
        "a:b.",
        "a:1",
        "ä:b",
        "a:b\n",
        "a:" + 200 * "b",
    ],
)
def test_what_python_cannot_import_is_refused_with_the_rule(name: str) -> None:
    (fault,) = faults(estimators=["hold", name], active_estimator="hold")
    assert fault.startswith("s: estimators.1: must read module:factory, both Python names, like my_filter:")


def test_a_slip_in_one_of_ours_is_guessed_and_anything_else_is_told_what_there_is() -> None:
    assert faults(estimators=["hold", "moesp_fk"], active_estimator="hold") == [
        "s: estimators.1: no such estimator, did you mean 'moesp_kf'? (got 'moesp_fk')"
    ]
    (fault,) = faults(estimators=["hold"], active_estimator="mine")
    assert fault.startswith("s: active_estimator: no such estimator; there are hold, damped_velocity, moesp_kf, ")
    assert fault.endswith(f"{NAMES[-1]}, and module:factory for a user-defined one (`tis estimators`) (got 'mine')")


@pytest.mark.parametrize("name", [name for name, row in ESTIMATORS.items() if row.judged_by])
def test_a_method_of_the_studies_is_named_by_its_module_and_its_topic_is_as_before(name: str) -> None:
    (fault,) = faults(estimators=["hold", name], active_estimator="hold")
    whole = f"tis.patient_side.estimators:{name}"
    assert f"is a method of `{ESTIMATORS[name].judged_by}`; a scenario names it {whole}" in fault
    scenario = build_scenario({**RAW, "estimators": ["hold", whole], "active_estimator": whole}, "s")
    assert [plain_name(each) for each in scenario.estimators] == ["hold", name]
    assert is_built_in(whole)
    assert not is_user_defined(whole)


def test_two_names_that_topics_could_not_tell_apart_are_refused() -> None:
    assert each_once(("a.b:C", "a.b:D")) == ("a.b:C", "a.b:D")
    with pytest.raises(ValueError, match=re.escape("a.b:C and a_b:C must differ in more than")):
        each_once(("a.b:C", "hold", "a_b:C"))
    with pytest.raises(ValueError, match="must name each estimator at most once"):
        each_once(("a:C", "a:C"))


def test_a_scenario_with_a_user_defined_one_needs_no_module_and_keeps_its_digest() -> None:
    scenario = build_scenario({**RAW, "estimators": ["hold", "no_such.module:F"], "active_estimator": "hold"}, "s")
    again = build_scenario(parse_yaml(dump_scenario(scenario), "s"), "s")
    assert again == scenario
    assert digest(again) == digest(scenario) != digest(build_scenario(RAW, "s"))


def test_the_schema_lists_our_names_and_has_a_pattern_for_others() -> None:
    for listed in (
        Scenario.model_json_schema()["properties"]["estimators"]["items"],
        Scenario.model_json_schema()["properties"]["active_estimator"],
    ):
        ours, own = listed["anyOf"]
        assert ours["enum"] == list(NAMES)
        assert re.search(own["pattern"], "my_lab.filters:AlphaBeta")
        assert not re.search(own["pattern"], "my-lab:AlphaBeta")
