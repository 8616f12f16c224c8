"""Shipped scenarios and estimators are listed, each with a line."""

import json

from tests.deploy.commands import call
from tis.common.estimators import ESTIMATORS, short_name
from tis.common.scenario.estimator_names import fault_of
from tis.deploy.shell.shipped_scenarios import shipped_names


def test_every_shipped_scenario_has_a_line() -> None:
    code, out, _ = call("scenarios", "--json")
    assert code == 0
    lines = json.loads(out)
    assert list(lines) == shipped_names()
    assert all(lines.values())
    assert all(name in call("scenarios")[1] for name in lines)


def test_every_estimator_has_a_line_under_the_name_that_a_scenario_takes() -> None:
    code, out, _ = call("estimators", "--json")
    assert code == 0
    lines = json.loads(out)
    assert len(lines) == len(ESTIMATORS)
    assert [fault_of(name) for name in lines] == [None] * len(lines)
    assert all(0 < len(line) < 150 for line in lines.values())
    printed = call("estimators")[1]
    assert all(short_name(name) in printed for name in lines)
