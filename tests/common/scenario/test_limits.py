import pytest

from tis.common.errors import InputError
from tis.common.scenario.limits import REQUIREMENTS, Limits, Requirement, RequirementSet
from tis.common.scenario.reading import apply_settings, build_scenario


def test_a_preset_fills_in_what_is_not_given() -> None:
    limits = Limits(preset="haptics").resolved()
    assert (limits.end_to_end_p99_ms, limits.p_loss_max, limits.rmse_3d_max_mm) == (2, 0.001, None)


def test_ones_own_numbers_win_over_the_preset_even_zero() -> None:
    limits = Limits(preset="augmented_reality", end_to_end_p99_ms=7, p_loss_max=0)
    resolved = limits.resolved()
    assert (resolved.end_to_end_p99_ms, resolved.p_loss_max, resolved.one_way_p99_ms) == (7, 0, 2)
    required = limits.requirements()
    assert [one.limit for one in required if one.metric == "end_to_end"] == [7]
    assert [one.limit for one in required if one.metric == "loss"] == [0, 0]
    assert {(one.limit, one.binding) for one in required if one.metric == "one_way"} == {(2, True), (0.5, False)}


def test_without_a_preset_nothing_is_added() -> None:
    assert Limits(p_loss_max=0.03).resolved() == Limits(p_loss_max=0.03)
    assert Limits().requirements() == ()


def test_limits_on_the_network_hold_each_way_those_on_the_patient_once() -> None:
    assert Limits(one_way_p99_ms=20, age_p99_ms=90, rmse_3d_max_mm=3).requirements() == (
        Requirement("one_way", 20, "forward", 99),
        Requirement("one_way", 20, "feedback", 99),
        Requirement("age", 90, None, 99),
        Requirement("rmse_3d", 3, None, None),
    )


@pytest.mark.parametrize("needed", REQUIREMENTS.values(), ids=REQUIREMENTS)
def test_every_set_says_where_it_stands_and_binds(needed: RequirementSet) -> None:
    assert len(needed.source) > 20
    assert any(one.binding for one in needed.requirements)
    for one in needed.requirements:
        assert one.limit > 0
        assert (one.percentile is None) == (one.metric == "loss")
        if not one.binding:  # the strict end of a range that has a lenient one
            lenient = [other for other in needed.requirements if other[:3:2] == one[:3:2] and other.binding]
            assert all(other.limit > one.limit for other in lenient)
            assert lenient


def test_the_former_limit_of_loss_in_per_cent_is_accepted_in_files_and_settings() -> None:
    raw = {"version": 1, "name": "s", "source": {"kind": "synthetic"}, "limits": {"loss_max_pct": 5}}
    assert build_scenario(raw, "s").limits == Limits(p_loss_max=0.05)
    newer = raw | {"limits": {"p_loss_max": 0.1}}
    for setting, limits in (
        ("limits.loss_max_pct=29", Limits(p_loss_max=0.29)),
        ("limits.p_loss_max=0.2", Limits(p_loss_max=0.2)),
        ("limits.p_loss_max=null", Limits()),
        ("limits.loss_max_pct=null", Limits()),
    ):
        for base in (raw, newer):
            assert build_scenario(apply_settings(base, [setting]), "s").limits == limits
    with pytest.raises(InputError, match=r"limits\.p_loss_max: must be at most 1"):
        build_scenario(raw | {"limits": {"loss_max_pct": 101}}, "s")
    with pytest.raises(InputError, match=r"limits\.loss_max_pct"):
        build_scenario(raw | {"limits": {"loss_max_pct": 5, "p_loss_max": 0.05}}, "s")


def test_a_share_at_its_limit_meets_it() -> None:
    assert [one.limit for one in Limits(p_loss_max=0.29).requirements()] == [29, 29]
