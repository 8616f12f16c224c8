"""Which kind of file a mapping is, by the shipped scenarios and profiles."""

import pytest

from tis.common.errors import InputError
from tis.common.runtime.scenario_files import read_scenario
from tis.common.scenario.file_kind import kind_of, refuse_network
from tis.deploy.net import profiles
from tis.deploy.shell import shipped_scenarios


def test_shipped_files_are_what_they_are() -> None:
    for name in shipped_scenarios.shipped_names():
        assert kind_of(read_scenario(shipped_scenarios.SHIPPED / f"{name}.yaml")) == "scenario"
    for name in profiles.shipped_names():
        raw = read_scenario(profiles.SHIPPED / f"{name}.yaml")
        assert kind_of(raw) == "profile"
        assert kind_of(raw["network"]) == kind_of({"network": raw["network"]}) == "network"


@pytest.mark.parametrize("raw", [{}, {"name": "x"}, {"version": 1, "forward": {}}, {"source": {}, "timeline": []}])
def test_what_is_unclear_counts_as_a_scenario_whose_faults_are_told(raw: dict[str, object]) -> None:
    assert kind_of(raw) == "scenario"
    refuse_network(raw, "x.yaml", "scenario")


def test_a_network_is_refused_with_its_use() -> None:
    with pytest.raises(
        InputError, match=r"x\.yaml: is a network, not a profile: `tis validate` checks it, `tis netem"
    ):
        refuse_network({"outages": []}, "x.yaml", "profile")
