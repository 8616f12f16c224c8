"""One process as a pure state machine: arrivals and the time go in, messages and records come out."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from pydantic import BaseModel

from common.channels import Network
from common.header import Header


class Arrival(NamedTuple):
    """A message as it came from the bus."""

    network: Network
    key: str
    payload: bytes
    attachment: bytes
    recv_ns: int


@dataclass(frozen=True, slots=True)
class Record:
    """Something to log: a model of ours, or bytes as they flew (then ``schema`` says what they are)."""

    topic: str
    log_ns: int
    data: BaseModel | bytes
    schema: type[BaseModel] | None = None
    publish_ns: int | None = None
    seq: int = 0


@dataclass(frozen=True, slots=True)
class Emission:
    """A message to send. A `Header` is stamped with the moment of sending; bytes are handed on untouched."""

    network: Network
    key: str
    payload: bytes
    attachment: Header | bytes
    on_sent: Callable[[int], Sequence[Record]]


Output = Emission | Record


class Node(Protocol):
    """A side of the testbed. It never learns whether its clock is the wall's, a virtual one or a recording."""

    @property
    def name(self) -> str:
        """Return the side's name, as in logs and errors."""
        ...

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the key expressions that the node wants, each with the network it stands on."""
        ...

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return the keys that the node will send on, as far as it knows them, each with its network."""
        ...

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Take one message; arrivals come in the order of ``recv_ns``."""
        ...

    def wake(self, now_ns: int) -> Iterable[Output]:
        """Do what is due at ``now_ns``, which is never before `next_wake_ns`; all of it is asked for at once.

        What is sent comes as soon as it is there, before what else is worked out.
        """
        ...

    def next_wake_ns(self) -> int | None:
        """Return when the node wants to be woken, in run time; None when it only listens."""
        ...

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the last records, at the end of the run."""
        ...

    def counters(self) -> dict[str, int]:
        """Return what was counted so far, by name."""
        ...
