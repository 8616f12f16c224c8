"""Construction of the emulator of a scenario, and of one between two networks without a scenario."""

from collections.abc import Mapping, Sequence

from tis.common.channels import Direction, keys_of, local_keys
from tis.common.scenario import Scenario
from tis.common.scenario.network import NetworkPart
from tis.common.trace import Trace
from tis.common.zenoh_syntax import KeySet
from tis.netem.conditions.conditions import Conditions
from tis.netem.link.link import Link
from tis.netem.link.rules import RuleTable, compile_rules
from tis.netem.node import NetemNode

Links = dict[Direction, Link]


def build_netem(scenario: Scenario, traces: Mapping[str, Trace] | None = None, where: str = "scenario") -> NetemNode:
    """Return a scenario's emulator in its initial state; raises `InputError` with every fault of the rules.

    ``traces`` has the recorded networks that the scenario names, by path; ``where`` names the scenario in errors.
    """
    network = scenario.network
    rules = compile_rules(network, where, scenario.impaired_keys, scenario.generated_rules())
    links = _links(network, rules, scenario.seed, traces)
    for direction, link in links.items():
        link.prepare(keys_of(direction, scenario.session))
    return NetemNode(**links, local=staying_keys(scenario))


def staying_keys(scenario: Scenario) -> KeySet:
    """Return the keys that stay on their network: set points, predictions, what programs of others tell."""
    session = scenario.session
    return KeySet((*local_keys(session, "west"), *local_keys(session, "east"), *scenario.source.device_keys))


def build_links(
    network: NetworkPart, keys: Sequence[str], seed: int, traces: Mapping[str, Trace] | None, where: str,
    own_connections: bool = False,
) -> Links:  # fmt: skip
    """Return the links of an emulator that impairs the keys that match ``keys``; raises `InputError`.

    With ``own_connections`` each key is a connection of its own that repeats what is lost, not one for all.
    """
    return _links(network, compile_rules(network, where, keys, below="rules"), seed, traces, own_connections)


def _links(
    network: NetworkPart, rules: Mapping[Direction, RuleTable], seed: int, traces: Mapping[str, Trace] | None,
    own_connections: bool = False,
) -> Links:  # fmt: skip
    return {
        direction: Link(
            direction, table, seed, Conditions.of(network, direction, seed), traces, network.buffer, own_connections
        )
        for direction, table in rules.items()
    }
