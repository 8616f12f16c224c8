"""What differs between scenarios, and what is said of it."""

from tests.deploy.report.hand_made import a_scenario
from tis.common.scenario import Scenario
from tis.deploy.report.compared import scenario_differences

DELAY = {"forward": {"delay": {"kind": "constant", "delay_ms": 40}}}


def test_equal_scenarios_differ_in_nothing() -> None:
    found = scenario_differences([a_scenario(), a_scenario(name="other")], ["live", "live"])
    assert found.fields == {}
    assert found.statement() == (
        "All runs have the same scenario and seed: what differs comes from the host they ran on."
    )


def test_other_seeds_are_repetitions() -> None:
    found = scenario_differences([a_scenario(seed=1), a_scenario(seed=2)], ["twin", "twin"])
    assert found.fields == {"seed": ("1", "2")}
    assert "repetitions" in found.statement()
    assert found.same_movement


def test_one_field_is_named() -> None:
    found = scenario_differences([a_scenario(duration_s=4), a_scenario(duration_s=5)], ["twin", "live"])
    assert found.fields == {"duration_s": ("4.0", "5.0")}
    assert "differ in one field of the scenario, duration_s" in found.statement()
    assert "Live and virtual time are mixed" in found.statement()


def test_a_part_that_one_has_is_absent_in_the_other() -> None:
    found = scenario_differences([a_scenario(network=DELAY), a_scenario()], ["twin", "twin"])
    assert found.fields["network.forward.delay.kind"] == ("constant", "-")
    assert found.fields["network.forward.delay.delay_ms"] == ("40.0", "-")
    assert "The runs have different scenarios." in found.statement()
    assert found.same_movement


def test_another_movement_makes_errors_incomparable() -> None:
    found = scenario_differences([a_scenario(rate_hz=30), a_scenario(rate_hz=60, network=DELAY)], ["twin", "twin"])
    assert not found.same_movement
    assert "errors in mm do not compare" in found.statement()
    hands = scenario_differences(
        [
            a_scenario(source={"kind": "synthetic", "hands": ["left"]}),
            a_scenario(source={"kind": "synthetic", "hands": ["left", "right"]}),
        ],
        ["twin"] * 2,
    )
    assert hands.same_movement


def test_entries_of_a_list_are_told_one_by_one() -> None:
    outages = [{"at_s": at_s, "for_s": 1, "set": {"outage": True}} for at_s in (6, 14)]
    calm = a_scenario(duration_s=20)
    found = scenario_differences([calm, a_scenario(duration_s=20, network={"timeline": outages})], ["twin", "twin"])
    assert found.fields["network.timeline[1].at_s"] == ("-", "14.0")
    assert found.fields["network.timeline[0].set.outage"] == ("-", "true")


def test_after_a_live_change_no_field_is_the_only_cause() -> None:
    longer = scenario_differences([a_scenario(duration_s=20), a_scenario(duration_s=30)], ["live", "live"])
    assert "what differs comes from it" in longer.statement()
    text = longer.statement(changed_live=True)
    assert "one field of the scenario, duration_s, as well; what differs in the figures may come from either" in text
    same = scenario_differences([a_scenario(), a_scenario()], ["live", "live"])
    assert "comes from these changes, or from the host" in same.statement(changed_live=True)


def _driven(seed: int = 1) -> Scenario:
    plant = {"plant": {"kind": "servo"}}
    return a_scenario(seed=seed, source={"kind": "live"}, patient=plant, identification={"train": "synthetic"})


def test_a_live_device_moves_another_way_in_each_run() -> None:
    again = scenario_differences([_driven(), _driven()], ["live", "live"])
    assert again.statement() == (
        "All runs have the same scenario and seed: what differs comes from the movement, or from the host. "
        "A live device moved the hand, another way in each run, so errors in mm do not compare."
    )
    assert not again.same_movement
    seeds = scenario_differences([_driven(1), _driven(2)], ["live", "live"])
    assert "repetitions" not in seeds.statement()
    assert "comes from it, or from the movement." in seeds.statement()
    beside = scenario_differences([_driven(), _driven()], ["live", "live"])
    assert "from these changes, the movement, or the host" in beside.statement(changed_live=True)
    recorded = scenario_differences([_driven(), a_scenario(seed=1)], ["live", "live"])
    assert "another way in each run" in recorded.statement()
