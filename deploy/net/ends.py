"""Ends of a probe: endpoints, sessions, and an interpreter that stalls little."""

import gc
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Final, NamedTuple, Self

import zenoh

from tis.common.errors import Fault, InputError, PeerError
from tis.common.runtime.connections import closing
from tis.common.runtime.scheduling import sharpen_timers
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client, open_router

_SWITCH_INTERVAL_S: Final = 0.0005


class Ends(NamedTuple):
    """Endpoints of the two ends of a probe.

    With ``listens`` the receiving end, or with a ``far`` end the local one, listens as a router.
    """

    sends_to: str
    receives_from: str
    listens: bool = False
    far: bool = False

    @classmethod
    def of(
        cls,
        connect: str | None,
        from_end: str | None,
        to_end: str | None,
        listen: str | None,
        reflector: bool = False,
    ) -> Self:
        """Return the ends given by the options; raises `InputError` for a missing or duplicate one."""
        if reflector:
            here = connect or listen
            if here is None or (connect and listen) or from_end or to_end:
                rule = (
                    "requires exactly one of --connect and --listen, for the local end, and excludes --from and --to"
                )
                raise InputError(Fault("tis net probe", "--reflector", rule))
            return cls(here, "", listens=connect is None, far=True)
        if listen is not None:
            if connect is not None or to_end is not None:
                raise InputError(
                    Fault("tis net probe", "--listen", "must not be given together with --connect or --to")
                )
            return cls(from_end or listen, listen, listens=True)
        sends, receives = from_end or connect, to_end or connect
        if sends is None or receives is None:
            missing = "--from" if sends is None else "--to"
            raise InputError(
                Fault(
                    "tis net probe",
                    missing,
                    "is required: both ends are in this process; for another host use --reflector and --connect",
                )
            )
        return cls(sends, receives)


def check_key(key: str, where: str) -> None:
    """Raise `InputError` unless it is a single key."""
    try:
        zenoh.KeyExpr(key)
    except zenoh.ZError:
        raise InputError(Fault(where, "--key", "must be a Zenoh key", key)) from None
    if "*" in key or "$" in key:
        raise InputError(Fault(where, "--key", "must be one key, without wildcards", key))


@contextmanager
def open_end(endpoint: str, listens: bool, options: ZenohOptions, wait_s: float, who: str) -> Iterator[zenoh.Session]:
    """Open a session that listens as a router or connects to one; raises `PeerError`, `InputError`."""
    if listens:
        config = configure("router", replace(options, listen=[endpoint]))
        with closing(open_router(config, endpoint, who), config) as router:
            yield router
        return
    give_up = time.monotonic() + wait_s
    config = configure("client", replace(options, connect=[endpoint]))
    session = open_client(config, lambda: time.monotonic() >= give_up, lambda: None)
    if session is None:
        raise PeerError(Fault(who, endpoint, f"no answer within {wait_s:g} s"))
    with closing(session, config):
        yield session


@contextmanager
def low_latency() -> Iterator[None]:
    """Reduce stalls of the interpreter: exact timers, short switch interval, no garbage collection."""
    switch_s, collects = sys.getswitchinterval(), gc.isenabled()
    sharpen_timers()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    gc.disable()
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
        if collects:
            gc.enable()
