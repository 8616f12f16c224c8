"""The control keys: presence of the sides, the run that they are in, clock queries and the end of a run.

All lie below ``<session>/@tis/``, which ``**`` does not match, so no rule applies to them and they are not forwarded.
netem is the only process on both networks; it is the time reference and mirrors each side's presence to the other
network. Presence is a liveliness token, which vanishes within milliseconds of the end of its process. A second token
names the run that a side is in: netem's begins the run, and tells it to a side that comes back; the other sides' tell
it to a netem that comes back.
"""

import hashlib
import json
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, get_args

import zenoh

from tis.common.channels import CONTROL, Side
from tis.common.runtime.clock import boot_id

_MAX_REASON_CHARS: Final = 500
_RUN: Final = "run"
_MAX_MET: Final = 100  # presences that a roster remembers; strangers may declare any number
_EPOCH: Final = re.compile(r"([0-9]{1,10})-([0-9]{1,19})-([0-9a-f]{16})")
_MAX_EPOCH_NS: Final = 1 << 62
_MAX_RUN_ID: Final = 1 << 32
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

    def run(self, side: Side, epoch: str) -> str:
        """Return the liveliness token of a side that is in the run with this `Epoch.text`."""
        return f"{self.session}/{CONTROL}/{_RUN}/{side}/{epoch}"

    def scenario(self, side: Side) -> str:
        """Return the key on which a side answers with the fields of its scenario."""
        return f"{self.session}/{CONTROL}/scenario/{side}"

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
    """The run's beginning on netem's clock, its number, by which its messages are known, and netem's boot.

    ``boot`` tells which clock ``epoch_ns`` is on (`boot_digest` of netem's host).
    """

    epoch_ns: int
    run_id: int
    boot: str

    @property
    def text(self) -> str:
        """Return the chunk of a key that names it."""
        return f"{self.run_id}-{self.epoch_ns}-{self.boot}"

    @classmethod
    def parse(cls, text: str) -> "Epoch | None":
        """Return the epoch that a chunk names; None for any other text (inverse: `text`)."""
        found = _EPOCH.fullmatch(text)
        if found is None:
            return None
        epoch = cls(int(found[2]), int(found[1]), found[3])
        return epoch if epoch.epoch_ns < _MAX_EPOCH_NS and epoch.run_id < _MAX_RUN_ID else None


def boot_digest() -> str:
    """Return a digest of this boot of the host's kernel: equal ones mean the same monotonic clock."""
    return hashlib.sha256(boot_id().encode()).hexdigest()[:16]


@dataclass
class Roster:
    """Sides that are present on one network, updated by Zenoh's callbacks; every change calls ``on_change``.

    ``met`` are all that ever were present: a refused side may be gone before the waiting thread looks. ``epochs`` are
    the runs that the present sides say they are in; ``epoch`` is the one that netem began first.
    """

    keys: ControlKeys
    on_change: Callable[[], None]
    present: set[Presence] = field(default_factory=set)
    met: set[Presence] = field(default_factory=set)
    left: list[Presence] = field(default_factory=list)
    epochs: dict[Side, Epoch] = field(default_factory=dict)
    epoch: Epoch | None = None
    end_reason: str | None = None
    _held: list[Any] = field(default_factory=list, repr=False)

    def watch(self, session: zenoh.Session) -> None:
        """Subscribe to the tokens and the end of the run."""
        self._held.append(session.declare_subscriber(self.keys.end, self._take_end))
        self._held.append(session.liveliness().declare_subscriber(self.keys.tokens, self._take_token, history=True))

    def sides(self) -> set[Side]:
        """Return the sides that are present, directly or mirrored."""
        return {presence.side for presence in tuple(self.present)}

    def _take_token(self, sample: zenoh.Sample) -> None:
        *_, place, side, digest = str(sample.key_expr).split("/")
        if side not in get_args(Side):
            return
        if place == _RUN:
            self._take_run(side, digest, sample.kind == zenoh.SampleKind.PUT)  # type: ignore[arg-type]
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

    def _take_run(self, side: Side, text: str, is_in: bool) -> None:
        epoch = Epoch.parse(text)
        if epoch is None:
            return
        if is_in:
            self.epochs[side] = epoch
        elif self.epochs.get(side) == epoch:
            del self.epochs[side]
        if is_in and side == "netem" and self.epoch is None:  # a run begins once
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
