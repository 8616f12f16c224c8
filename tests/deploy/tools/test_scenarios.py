"""Shipped scenarios are listed, each with a line."""

import json

from tests.deploy.commands import call
from tis.deploy.shell.shipped_scenarios import shipped_names


def test_every_shipped_scenario_has_a_line() -> None:
    code, out, _ = call("scenarios", "--json")
    assert code == 0
    lines = json.loads(out)
    assert list(lines) == shipped_names()
    assert all(lines.values())
    assert all(name in call("scenarios")[1] for name in lines)
