"""A side as a pure state machine: arrivals and the time go in, messages and records come out."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, Protocol

from msgspec import Struct

from tis.common.channels import Network
from tis.common.messages import Header, Message
from tis.common.peer_life import Alarm
from tis.common.signing import Identity, RunKeys


class Arrival(NamedTuple):
    """A message from the bus, stamped with its arrival in run time."""

    network: Network
    key: str
    payload: bytes
    attachment: bytes
    recv_ns: int


class Record(Struct, frozen=True):
    """An entry of the log: a model, or a payload's bytes as received, with their model in ``schema``."""

    topic: str
    log_ns: int
    data: Message | bytes
    schema: type[Message] | None = None
    publish_ns: int | None = None
    seq: int = 0


class Emission(Struct, frozen=True):
    """A message to send; a `Header` is stamped with the send time, other attachments are passed on unchanged.

    ``on_sent`` is called with the run time at which the message left, and returns the records to log.
    """

    network: Network
    key: str
    payload: bytes
    attachment: Header | bytes
    on_sent: Callable[[int], Sequence[Record]]


Output = Emission | Record


class Node(Protocol):
    """A side of the testbed; the same code runs live, in virtual time and from a recording."""

    @property
    def name(self) -> str:
        """Return the side's name, for logs and errors."""

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the key expressions to subscribe to, each with its network."""

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return the known keys that the node will publish on, each with its network."""

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Process one message; arrivals come in the order of ``recv_ns``."""

    def wake(self, now_ns: int) -> Iterable[Output]:
        """Do what is due at ``now_ns``, which is never before `next_wake_ns`; the caller exhausts the result.

        Messages are yielded as soon as they are computed, before any further work.
        """

    def next_wake_ns(self) -> int | None:
        """Return the run time at which the node is to be woken next; None when it only listens."""

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the last records, at the end of the run."""

    def counters(self) -> dict[str, int]:
        """Return the present counters by name."""


class SideNode(Node, Protocol):
    """The surgeon or the patient, which takes part in one run."""

    @property
    def doing(self) -> str:
        """Return the step that is being computed, where it may take long; "" otherwise."""

    def remembers(self) -> Sequence[str]:
        """Return the topics whose last records a process that is started anew must know."""

    def resume(self, last: Mapping[str, bytes]) -> None:
        """Go on after these records of an earlier process of this side, by topic."""

    def alarms(self) -> Mapping[Alarm, int]:
        """Return what the side has evidence of, by the run time at which it began; from any thread."""

    def believe(self, keys: RunKeys, own: Identity) -> None:
        """Use only what the other side has signed under these keys, and sign what is sent; ``own`` proves names."""

    def join(self, run_id: int, from_ns: int = 0) -> None:
        """Take messages of this run only, from now on; the node's ticks before ``from_ns`` are not its own."""
