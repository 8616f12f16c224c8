"""What the tests of the emulator are made of: scenarios, pipelines and packets."""

from collections.abc import Mapping
from typing import Any

from tis.common.channels import Direction, Network
from tis.common.messages import Header
from tis.common.node import Arrival
from tis.common.scenario import Scenario
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.trace import Trace
from tis.netem.conditions.conditions import Condition, Conditions
from tis.netem.conditions.outage import Outage
from tis.netem.conditions.states import NO_STATE, StatePath
from tis.netem.draws.grid import CELL_NS, cell_of
from tis.netem.link.link import Link
from tis.netem.link.packet import Fate
from tis.netem.link.rules import compile_rules

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
    topology: str = "teleoperation",
    traces: Mapping[str, Trace] | None = None,
    **network: Any,
) -> Link:
    made = scenario(topology, **network)
    rules = compile_rules(made.network, "test.yaml", ["tis/**"], made.generated_rules())
    conditions = Conditions.of(made.network, direction, made.seed)
    return Link(direction, rules[direction], made.seed, conditions, traces, made.network.buffer)


def offer(link: Link, packet: Arrival, now_ns: int) -> Fate:
    return link.offer(packet.key, packet.attachment, len(packet.payload), now_ns, packet)


def packet(
    recv_ns: int,
    seq: int | None = None,
    key: str = KEY,
    payload: bytes = b"payload",
    network: Network = "west",
) -> Arrival:
    """Return an arrival with our attachment, or with a foreign one when there is no ``seq``."""
    attachment = b"foreign" if seq is None else Header(seq, recv_ns).pack()
    return Arrival(network, key, payload, attachment, recv_ns)


def is_out(outage: Outage, now_ns: int) -> bool:
    return outage.path.at(cell_of(now_ns)).value == 1


def state_at(path: StatePath, now_ns: int) -> tuple[str | None, int]:
    """Return the state, None before a script's first step, and when it may end, exclusive."""
    stretch = path.at(cell_of(now_ns))
    return None if stretch.value == NO_STATE else path.names[stretch.value], stretch.end * CELL_NS


def are_alike(one: Condition, other: Condition) -> bool:
    """Tell whether the same holds in both, whenever that is."""
    return one == other._replace(since_ns=one.since_ns, until_ns=one.until_ns)
