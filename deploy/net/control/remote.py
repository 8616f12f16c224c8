"""A running emulator, as a client of its network sees it: the control keys."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import zenoh
from pydantic import BaseModel, ValidationError

from common.errors import Fault, InputError, PeerError
from common.runtime.zenoh_session import ZenohOptions, configure, visitor
from common.scenario.control import EVERY_STATE, STATE, Acknowledgement, EmulatorState, control_prefix

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
_TIME_OUT_S: Final = 3.0
_WHERE: Final = "tis net"

Answer = TypeVar("Answer", bound=BaseModel)


class EmulatorAddress(NamedTuple):
    """Where an emulator is, what it goes by, and how one connects to it."""

    endpoint: str = DEFAULT_ENDPOINT
    prefix: str = "tis"
    config: Path | None = None
    cfg: tuple[str, ...] = ()

    def client(self) -> zenoh.Config:
        """Return the configuration of a client there; raises `InputError`."""
        return visitor(self.endpoint, ZenohOptions(config=self.config, cfg=self.cfg))


def emulator_address(
    connect: str | None, prefix: str, config: Path | None, cfg: Sequence[str] | None
) -> EmulatorAddress:
    """Return what a command's options mean; raises `InputError`.

    Without ``connect`` the endpoint is the configuration's first one, else the default.
    """
    given = tuple(cfg or ())
    if connect is None and (config is not None or given):
        options = ZenohOptions(config=config, cfg=given)
        found = json.loads(configure("client", options).get_json("connect/endpoints"))
        named = found.get("client", []) if isinstance(found, dict) else found or []
        connect = next(iter(named), None)
    return EmulatorAddress(connect or DEFAULT_ENDPOINT, prefix, config, given)


class Remote:
    """Asks an emulator. Raises `PeerError` when nobody answers."""

    def __init__(self, session: zenoh.Session, address: EmulatorAddress) -> None:
        self._session = session
        self._address = address

    def state(self) -> EmulatorState:
        """Return what holds now; raises `InputError` while nothing passes."""
        state = self._query(STATE, None, EmulatorState)
        if not state.running:
            raise InputError(Fault(_WHERE, self._address.endpoint, "the emulator is there, but no run is"))
        return state

    def request(self, operation: str, request: Any) -> Acknowledgement:
        """Return the answer to a request, which may be a refusal."""
        return self._query(operation, json.dumps(request), Acknowledgement)

    def _query(self, operation: str, payload: str | None, model: type[Answer]) -> Answer:
        key = f"{control_prefix(self._address.prefix)}{operation}"
        replies = [
            reply.ok.payload.to_bytes()
            for reply in self._session.get(key, payload=payload, timeout=_TIME_OUT_S)
            if reply.ok is not None
        ]
        if not replies:
            prefixes = self._prefixes()
            instead = f"--prefix {' or '.join(prefixes)} is there" if prefixes else "no emulator is there"
            rule = f"connected, but nobody answers on {key}: {instead}"
            raise PeerError(Fault(_WHERE, self._address.endpoint, rule))
        answers = [self._answer(reply, model, key) for reply in replies]
        if len(answers) > 1:
            rule = f"{len(answers)} emulators answer on {key}, and each has done it: give each a prefix of its own"
            raise InputError(Fault(_WHERE, self._address.endpoint, rule))
        return answers[0]

    def _prefixes(self) -> list[str]:
        """Return the prefixes of all emulators of this network that answer."""
        replies = self._session.get(EVERY_STATE, timeout=_TIME_OUT_S)
        return sorted({str(reply.ok.key_expr).partition("/")[0] for reply in replies if reply.ok is not None})

    def _answer(self, reply: bytes, model: type[Answer], key: str) -> Answer:
        try:
            return model.model_validate_json(reply)
        except ValidationError:
            rule = f"what answers on {key} is no emulator, or one of another version"
            raise PeerError(Fault(_WHERE, self._address.endpoint, rule)) from None


@contextmanager
def connected(address: EmulatorAddress) -> Iterator[Remote]:
    """Connect as a client; raises `PeerError` when nobody is there, `InputError` for an endpoint that is none."""
    if not address.prefix or "/" in address.prefix or set(address.prefix) & set("*$?#"):
        raise InputError(Fault(_WHERE, "--prefix", "must be the first chunk of keys, like tis", address.prefix))
    config = address.client()
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        if "Unable to connect" in str(error):
            rule = "cannot connect: nothing listens there, or it takes no client of this kind (-c, --cfg)"
            raise PeerError(Fault(_WHERE, address.endpoint, rule)) from None
        reason = " ".join(str(error).split()).split(" at /")[0]
        raise InputError(Fault(_WHERE, address.endpoint, reason)) from None
    with session:
        yield Remote(session, address)
