"""An attacker in a twin: it sends forged messages on the patient's network at their instants."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from tis.common.channels import Network
from tis.common.messages import Header
from tis.common.node import Arrival, Emission, Output, Record


class Forged(NamedTuple):
    """A message to inject at an instant."""

    at_ns: int
    key: str
    seq: int
    payload: bytes


@dataclass
class Attacker:
    """Sends forged messages at their instants."""

    messages: Sequence[Forged]
    name: str = "attacker"
    _due: list[Forged] = field(init=False)

    def __post_init__(self) -> None:
        self._due = sorted(self.messages, key=lambda one: one.at_ns, reverse=True)

    def listens(self) -> Sequence[tuple[Network, str]]:
        return []

    def publishes(self) -> Sequence[tuple[Network, str]]:
        return []

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        return []

    def next_wake_ns(self) -> int | None:
        return self._due[-1].at_ns if self._due else None

    def wake(self, now_ns: int) -> Iterable[Output]:
        while self._due and self._due[-1].at_ns <= now_ns:
            one = self._due.pop()
            yield Emission("east", one.key, one.payload, Header(one.seq), lambda _: ())

    def finish(self, now_ns: int) -> Sequence[Record]:
        return []

    def counters(self) -> dict[str, int]:
        return {}
