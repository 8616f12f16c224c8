"""Overrides that can be applied beside such that cannot; see also tests/deploy/run/test_resolve_faults."""

from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.errors import Fault
from tis.common.scenario.overrides import Override, apply_overrides, blamed
from tis.common.scenario.reading import apply_settings

RAW = {"seed": 1, "list": [1, 2], "network": {"forward": {"loss": {"kind": "bernoulli", "p_loss": 0.1}}}}
GOOD = ("seed=2", "a.b=3", "list.1=7", "network.forward.loss=null", "a.c={d: 1}")
BAD = ("seed", "list.2=1", "a.b=[", "network.forward.loss.fnord=1", ".=2")


@settings(deadline=None, max_examples=60)
@given(st.lists(st.sampled_from(GOOD + BAD), max_size=6, unique=True))
def test_the_good_ones_are_applied_and_of_the_others_each_has_its_fault(chosen: list[str]) -> None:
    found, faults = apply_overrides(RAW, [Override("--sweep", one) for one in chosen], ["network"])
    assert found == apply_settings(RAW, [one for one in chosen if one in GOOD])
    assert len(faults) == len([one for one in chosen if one in BAD])
    assert all(fault.where.startswith("--sweep") for fault in faults)


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.builds(Fault, st.sampled_from(["s.yaml", "p.yaml"]), st.sampled_from(["", "a", "a.b"]), st.just("r"))
    ),
    st.lists(st.sampled_from(["a=1", "a.b=1", "c=1"]), min_size=1),
    st.booleans(),
)
def test_no_fault_is_lost_and_those_of_files_stay_theirs(
    faults: list[Fault], chosen: list[str], is_user_defined: bool
) -> None:
    found = blamed(faults, "s.yaml", faults if is_user_defined else [], [Override("--set", one) for one in chosen])
    assert len(found) == len(faults)
    for fault, after in zip(faults, found, strict=True):
        assert after.rule.endswith(fault.rule)
        assert (after == fault) == (is_user_defined or fault.where == "p.yaml")
