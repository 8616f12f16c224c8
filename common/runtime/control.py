"""The control keys: presence of the sides, clock queries, the epoch and the end of a run.

All lie below ``<session>/@tis/``, which ``**`` does not match, so no rule applies to them and they are not forwarded.
netem is the only process on both networks; it is the time reference and mirrors each side's presence to the other
network. Presence is a liveliness token, which vanishes within milliseconds of the end of its process.
"""

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, get_args

import zenoh

from common.channels import CONTROL, Side

_MAX_REASON_CHARS: Final = 500
_MAX_MET: Final = 100  # presences that a roster remembers; strangers may declare any number
_BOUNDS: Final = (1 << 62, 1 << 32)
"""Of an epoch's instant and of a run's number."""
_MALFORMED: Final = (ValueError, KeyError, TypeError, RecursionError)
"""Exceptions that a foreign message on a control key can cause."""


@dataclass(frozen=True)
class ControlKeys:
    """The control keys of one session."""

    session: str

    def token(self, side: Side, digest: str, mirrored: bool) -> str:
        """Return the liveliness token of a side that runs the scenario with this ``digest``."""
        return f"{self.session}/{CONTROL}/{'mirror' if mirrored else 'side'}/{side}/{digest}"

    @property
    def tokens(self) -> str:
        """Return the expression that matches every token."""
        return f"{self.session}/{CONTROL}/*/*/*"

    @property
    def beats(self) -> str:
        """Return the expression that matches every side's beats."""
        return f"{self.session}/{CONTROL}/beat/*"

    def beat(self, side: Side) -> str:
        """Return the key of a side's signs of life."""
        return f"{self.session}/{CONTROL}/beat/{side}"

    @property
    def clock(self) -> str:
        """Return the key on which netem answers with its clock."""
        return f"{self.session}/{CONTROL}/clock"

    def scenario(self, side: Side) -> str:
        """Return the key on which a side answers with the fields of its scenario."""
        return f"{self.session}/{CONTROL}/scenario/{side}"

    @property
    def epoch(self) -> str:
        """Return the key on which netem publishes the epoch."""
        return f"{self.session}/{CONTROL}/epoch"

    @property
    def end(self) -> str:
        """Return the key on which a side publishes its reason to end the run."""
        return f"{self.session}/{CONTROL}/end"


class Presence(NamedTuple):
    """A side, as described by its token."""

    side: Side
    digest: str
    mirrored: bool


class Epoch(NamedTuple):
    """The run's beginning on netem's clock, and its number, by which its messages are known."""

    epoch_ns: int
    run_id: int

    def dumped(self) -> str:
        """Return the message that announces it."""
        return json.dumps(self._asdict())


@dataclass
class Roster:
    """Sides that are present on one network, updated by Zenoh's callbacks; every change calls ``on_change``.

    ``met`` are all that ever were present: a refused side may be gone before the waiting thread looks.
    """

    keys: ControlKeys
    on_change: Callable[[], None]
    present: set[Presence] = field(default_factory=set)
    met: set[Presence] = field(default_factory=set)
    left: list[Presence] = field(default_factory=list)
    epoch: Epoch | None = None
    end_reason: str | None = None
    _held: list[Any] = field(default_factory=list, repr=False)

    def watch(self, session: zenoh.Session) -> None:
        """Subscribe to the tokens, the epoch and the end of the run."""
        self._held.append(session.declare_subscriber(self.keys.epoch, self._take_epoch))
        self._held.append(session.declare_subscriber(self.keys.end, self._take_end))
        self._held.append(session.liveliness().declare_subscriber(self.keys.tokens, self._take_token, history=True))

    def sides(self) -> set[Side]:
        """Return the sides that are present, directly or mirrored."""
        return {presence.side for presence in tuple(self.present)}

    def _take_token(self, sample: zenoh.Sample) -> None:
        *_, place, side, digest = str(sample.key_expr).split("/")
        if side not in get_args(Side):
            return
        presence = Presence(side, digest, place == "mirror")  # type: ignore[arg-type]
        if presence not in self.met and len(self.met) >= _MAX_MET:
            return
        if sample.kind == zenoh.SampleKind.PUT:
            self.present.add(presence)
            self.met.add(presence)
        elif presence in self.present:
            self.present.discard(presence)
            self.left.append(presence)
        self.on_change()

    def _take_epoch(self, sample: zenoh.Sample) -> None:
        if str(sample.key_expr) != self.keys.epoch:  # a put may name many keys at once
            return
        try:
            found = json.loads(sample.payload.to_bytes())
            epoch = Epoch(found["epoch_ns"], found["run_id"])
        except _MALFORMED:
            return
        # isinstance would accept JSON's true, and a stamp has 64 bits
        possible = all(type(value) is int and 0 <= value < bound for value, bound in zip(epoch, _BOUNDS, strict=True))
        if possible and self.epoch is None:  # a run begins once
            self.epoch = epoch
            self.on_change()

    def _take_end(self, sample: zenoh.Sample) -> None:
        if str(sample.key_expr) != self.keys.end:
            return
        try:
            reason = json.loads(sample.payload.to_bytes())["reason"]
        except _MALFORMED:
            return
        if isinstance(reason, str):
            self.end_reason = self.end_reason or reason[:_MAX_REASON_CHARS]
            self.on_change()


class Bell:
    """Wakes the thread that waits for a change of the control plane."""

    def __init__(self) -> None:
        self._event = threading.Event()

    def ring(self) -> None:
        """Wake the waiter; safe from callbacks and signal handlers."""
        self._event.set()

    def wait(self, timeout_s: float) -> None:
        """Wait until rung, or for ``timeout_s``."""
        self._event.wait(timeout_s)
        self._event.clear()
