"""What the tests of the emulator are made of: scenarios, pipelines and packets."""

from typing import Any

from common.channels import Direction, Network
from common.header import Header
from common.node import Arrival
from common.scenario import Scenario
from common.scenario.network import Pipeline
from netem.link import MAX_HELD, Link
from netem.outage import Outages
from netem.rules import compile_rules

KEY = "tis/MTML/measured_cp"


def scenario(topology: str = "teleoperation", seed: int = 7, **network: Any) -> Scenario:
    raw = {
        "version": 1,
        "name": "test",
        "seed": seed,
        "source": {"kind": "synthetic"},
        "topology": topology,
        "network": network,
    }
    return Scenario.model_validate(raw)


def pipeline(**stages: Any) -> Pipeline:
    return Pipeline.model_validate(stages)


def link(
    direction: Direction = "forward",
    max_held: int = MAX_HELD,
    topology: str = "teleoperation",
    **network: Any,
) -> Link:
    made = scenario(topology, **network)
    rules = compile_rules(made, "test.yaml")
    outages = Outages.of_timeline(made.network.timeline, direction)
    return Link(direction, rules[direction], made.seed, outages, max_held)


def packet(
    recv_ns: int,
    seq: int | None = None,
    key: str = KEY,
    payload: bytes = b"payload",
    network: Network = "west",
) -> Arrival:
    """Return an arrival with our attachment, or with a foreign one when there is no ``seq``."""
    attachment = b"foreign" if seq is None else Header(seq, recv_ns).pack()
    return Arrival(network, key, payload, attachment, recv_ns, passport=("passport", recv_ns))
