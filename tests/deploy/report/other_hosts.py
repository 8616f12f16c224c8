"""A twin whose sides live on hosts of their own, each by a clock that is wrong by a known amount."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.common.clocks.wrong_clock import S, WrongClock, exchanges
from tis.common.channels import Network, Side
from tis.common.host_records import CLOCK, EXCHANGES, ClockNote, ExchangeNote
from tis.common.messages import Header
from tis.common.node import Arrival, Emission, Node, Output, Record
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.run.twin import build_sides, drive
from tis.patient_side.statespace import ArmModel

MONOTONIC_NS = 10**15


@dataclass
class OnAnotherHost:
    """A node that is told the time by a wrong clock, and stamps with it; the bus goes by the reference's."""

    node: Node
    clock: WrongClock

    @property
    def name(self) -> str:
        return self.node.name

    def listens(self) -> Sequence[tuple[Network, str]]:
        return self.node.listens()

    def publishes(self) -> Sequence[tuple[Network, str]]:
        return self.node.publishes()

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        own_ns = self._own_ns(arrival.recv_ns)
        return [self._stamped(output, own_ns) for output in self.node.receive(arrival._replace(recv_ns=own_ns))]

    def wake(self, now_ns: int) -> Sequence[Output]:
        own_ns = self._own_ns(now_ns)
        return [self._stamped(output, own_ns) for output in self.node.wake(own_ns)]

    def next_wake_ns(self) -> int | None:
        due_ns = self.node.next_wake_ns()
        if due_ns is None:
            return None
        reference_ns = round(due_ns * (1 + self.clock.drift_ppm * 1e-6)) + self.clock.offset_ns
        while self._own_ns(reference_ns) < due_ns:  # never woken early
            reference_ns += 1
        return max(reference_ns, 0)

    def finish(self, now_ns: int) -> Sequence[Record]:
        return self.node.finish(self._own_ns(now_ns))

    def counters(self) -> dict[str, int]:
        return self.node.counters()

    def _own_ns(self, reference_ns: int) -> int:
        return int(self.clock.shows([reference_ns])[0])

    def _stamped(self, output: Output, own_ns: int) -> Output:
        if isinstance(output, Record):
            return output
        attachment = output.attachment
        if isinstance(attachment, Header):
            attachment = attachment._replace(sent_ns=own_ns).pack()
        return Emission(
            output.network, output.key, output.payload, attachment, lambda ns: output.on_sent(self._own_ns(ns))
        )


def run_apart(
    scenario: Scenario,
    clocks: Mapping[Side, WrongClock],
    hosts: Mapping[Side, str],
    way_ns: int = 100_000,
    asymmetry: float = 0.8,
) -> tuple[dict[Side, MemoryLog], tuple[ArmModel, ...]]:
    """Run a twin with some sides apart; return the logs as they were written, exchanges with the reference included.

    Clocks are in run time: what the agreed epoch leaves. Each side's log says besides that its monotonic clock shows
    `MONOTONIC_NS` less than netem's.
    """
    nodes, models, _ = build_sides(scenario)
    apart = {side: OnAnotherHost(node, clocks[side]) if side in clocks else node for side, node in nodes.items()}
    logs = {side: MemoryLog(side) for side in nodes}
    for seed, (side, clock) in enumerate(clocks.items()):
        note = ClockNote(
            boot_id=hosts[side], reference_boot_id="netem's", shared=False,
            epoch_ns=5 * S - clock.offset_ns, reference_epoch_ns=MONOTONIC_NS + 5 * S,
        )  # fmt: skip
        logs[side].record(Record(CLOCK, 0, note))
        n = 4 * round(scenario.end_ns / S)
        asked = exchanges(clock.shows, n, S // 4, way_ns, seed, asymmetry, begin_ns=-S // 2)
        for row in zip(asked.asked_ns, asked.received_ns, asked.replied_ns, asked.answered_ns, strict=True):
            names = ("asked_ns", "received_ns", "replied_ns", "answered_ns")
            exchange = ExchangeNote(**dict(zip(names, map(int, row), strict=True)))
            logs[side].record(Record(EXCHANGES, exchange.answered_ns, exchange))
    drive(scenario, apart, logs)
    return logs, models


def as_run(logs: Mapping[Side, MemoryLog]) -> RunLogs:
    return RunLogs(Path(), {side: memory.log for side, memory in logs.items()})
