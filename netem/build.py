"""The emulator that a scenario asks for."""

from common.channels import Direction, keys_of
from common.scenario import Scenario
from netem.link import Link
from netem.node import NetemNode
from netem.outage import Outages
from netem.rules import compile_rules


def build_netem(scenario: Scenario, where: str = "scenario") -> NetemNode:
    """Return the emulator in its initial state; raises `InputError` with every fault of the rules.

    ``where`` names the scenario in errors, like its file.
    """
    rules = compile_rules(scenario, where)

    def link(direction: Direction) -> Link:
        outages = Outages.of_timeline(scenario.network.timeline, direction)
        made = Link(direction, rules[direction], scenario.seed, outages)
        made.prepare(keys_of(direction, scenario.session))
        return made

    return NetemNode(forward=link("forward"), feedback=link("feedback"))
