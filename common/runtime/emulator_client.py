"""Client of a running emulator's control keys."""

import json
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, TypeVar

import zenoh
from pydantic import BaseModel, ValidationError

from tis.common.errors import Fault, InputError, PeerError
from tis.common.runtime.connections import closing
from tis.common.runtime.running import UNKNOWN, WEST, Running, sessions
from tis.common.runtime.tls_links import of_netem_only
from tis.common.runtime.zenoh_session import ZenohOptions, configure, visitor
from tis.common.scenario.control import EVERY_STATE, STATE, Acknowledgement, EmulatorState, control_prefix

_TIME_OUT_S: Final = 3.0
_CUT_S: Final = 1.0  # a refused client connects again, and is cut again, within milliseconds
_WHERE: Final = "tis net"
_NOBODY: Final = "there is no emulator, or it refuses this client: its own warnings say so"
_CUT: Final = (
    "the other end closes the connection; netem refuses this client (its own warning says why, such as a revoked "
    "certificate), or it ends"
)

Answer = TypeVar("Answer", bound=BaseModel)


class EmulatorAddress(NamedTuple):
    """Endpoint of an emulator, prefix of its control keys, Zenoh options, and the file of a run's shared secret."""

    endpoint: str = WEST
    prefix: str = "tis"
    options: ZenohOptions = ZenohOptions()
    secret: Path | None = None
    title: str = ""
    """What runs there, where that is known."""

    def __str__(self) -> str:
        title = f" ({self.title})" if self.title else ""
        return f"{self.endpoint}, {self.prefix}{title}"

    def client(self) -> zenoh.Config:
        """Return the Zenoh configuration of a client; raises `InputError`."""
        return visitor(self.endpoint, self.options)


def emulator_address(
    connect: str | None, prefix: str | None, config: Path | None, cfg: Sequence[str] | None
) -> EmulatorAddress:
    """Return the address given by a command's options; raises `InputError`.

    Without ``connect`` the endpoint is the configuration's first one, else that of what runs on this machine.
    """
    options = ZenohOptions(config=config, cfg=tuple(cfg or ()))
    if connect is None and (config is not None or options.cfg):
        found = json.loads(configure("client", options).get_json("connect/endpoints"))
        named = found.get("client", []) if isinstance(found, dict) else found or []
        connect = next(iter(named), None)
    if connect is not None:
        return EmulatorAddress(connect, prefix or Running().session, options)
    here = running_here(_WHERE, ("--connect",), prefix) or Running()
    title = "" if here.title == UNKNOWN else here.title
    return EmulatorAddress(here.west, prefix or here.session, options, title=title)


def running_here(where: str, options: Sequence[str], prefix: str | None) -> Running | None:
    """Return what runs on this machine, None without any; raises `InputError` where several could be meant.

    ``options`` are those by which the command takes an emulator's endpoints, west and east.
    """
    found = [one for one in sessions() if prefix in (None, one.session)]
    if len(found) > 1:
        rule = f"must name one of those that run on this machine: {'; '.join(one.named_by(options) for one in found)}"
        raise InputError(Fault(where, options[0], rule))
    return found[0] if found else None


class OtherPrefixError(PeerError):
    """An emulator answers there, but on keys with another prefix."""


class Remote:
    """Control connection to an emulator. Raises `PeerError` without an answer."""

    def __init__(self, session: zenoh.Session, address: EmulatorAddress) -> None:
        self.session = session
        self._address = address
        self._is_cut = threading.Event()

    @contextmanager
    def noting_cuts(self) -> Iterator[Self]:
        """Note while the block lasts whether the other end closes the connection."""

        def take(event: zenoh.LinkEvent) -> None:
            if event.kind == zenoh.SampleKind.DELETE:
                self._is_cut.set()

        listener = self.session.info.declare_link_events_listener(take, history=False)
        try:
            yield self
        finally:
            with suppress(zenoh.ZError):
                listener.undeclare()  # type: ignore[no-untyped-call]

    def state(self) -> EmulatorState:
        """Return the state in force; raises `InputError` when no run is in progress."""
        state = self._query(STATE, None, EmulatorState)
        if not state.running:
            raise InputError(Fault(_WHERE, self._address.endpoint, "the emulator answers, but no run is in progress"))
        return state

    def request(self, operation: str, request: Any) -> Acknowledgement:
        """Return the answer to a request, which may be a refusal."""
        return self._query(operation, json.dumps(request), Acknowledgement)

    def _query(self, operation: str, payload: str | None, model: type[Answer]) -> Answer:
        key = f"{control_prefix(self._address.prefix)}{operation}"
        replies = [
            reply.ok.payload.to_bytes()
            for reply in self.session.get(key, payload=payload, timeout=_TIME_OUT_S)
            if reply.ok is not None
        ]
        if not replies:
            prefixes = self._prefixes()
            instead, kind = _NOBODY, PeerError
            if self._address.prefix in prefixes:
                instead = "this client may not ask that; see control in the scenario's security"
            elif prefixes:
                instead, kind = f"use --prefix {' or '.join(prefixes)}", OtherPrefixError
            elif self._is_cut.wait(_CUT_S):
                instead = _CUT
            rule = f"connected, but nothing answers on {key}: {instead}"
            raise kind(Fault(_WHERE, self._address.endpoint, rule))
        answers = [self._answer(reply, model, key) for reply in replies]
        if len(answers) > 1:
            rule = (
                f"{len(answers)} emulators answered on {key} and executed the request: give each a different prefix"
            )
            raise InputError(Fault(_WHERE, self._address.endpoint, rule))
        return answers[0]

    def _prefixes(self) -> list[str]:
        """Return the prefixes of all emulators of this network that answer."""
        replies = self.session.get(EVERY_STATE, timeout=_TIME_OUT_S)
        return sorted({str(reply.ok.key_expr).partition("/")[0] for reply in replies if reply.ok is not None})

    def _answer(self, reply: bytes, model: type[Answer], key: str) -> Answer:
        try:
            return model.model_validate_json(reply)
        except ValidationError:
            rule = f"the answer on {key} is not from an emulator, or from another version"
            raise PeerError(Fault(_WHERE, self._address.endpoint, rule)) from None


@contextmanager
def connected(address: EmulatorAddress) -> Iterator[Remote]:
    """Connect as a client; raises `PeerError` when nothing listens, `InputError` for an invalid endpoint."""
    if not address.prefix or "/" in address.prefix or set(address.prefix) & set("*$?#"):
        raise InputError(Fault(_WHERE, "--prefix", "must be a single chunk of a key, such as tis", address.prefix))
    config = address.client()
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        if "Unable to connect" in str(error):
            rule = "cannot connect: nothing listens there, or it refuses this client (-c, --cfg)"
            raise PeerError(Fault(_WHERE, address.endpoint, rule)) from None
        reason = " ".join(str(error).split()).split(" at /")[0]
        raise InputError(Fault(_WHERE, address.endpoint, reason)) from None
    link = of_netem_only(session, config, _WHERE)
    with closing(session, config), link, Remote(session, address).noting_cuts() as remote:
        yield remote
