"""A child process that lists the queryables of a network: a Zenoh client that reads what its router has declared.

It reads its own admin space, never a router's. Up to Zenoh 1.10 an answer of the admin space takes the lock of the
routing tables twice; a declaration in between leaves them locked forever (Zenoh's pull request 2619). A valve holds
back declarations meanwhile (`tis.netem.bridge.mirrors.valve`), if the connection to the router is a plain socket. A
deadlock that occurs nevertheless is limited to this process: a timer ends it, and `tis.netem.bridge.mirrors.listing`
starts another.

Standard input has one line (`Settings` as JSON); its end ends the process. Standard output gets an empty line first,
then a line per reading: the keys as JSON if they have changed, else an empty line as a sign of life.
"""

import contextlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Final, NamedTuple, NoReturn

import zenoh

from tis.netem.bridge.mirrors.valve import valve_to

_PAUSE_S: Final = 0.1
_PAUSE_RATIO: Final = 20  # pause over processor time of a reading: bounds the load of many queryables
_MAX_PAUSE_S: Final = 0.5
_MAX_READ_S: Final = 0.5
_ANSWER_S: Final = 2.0
_UNUSED_KEY: Final = "@tis/netem/nobody"

Closed = Callable[[], AbstractContextManager[None]]


class Settings(NamedTuple):
    """The client's configuration (JSON), and the key expressions that listed queryables overlap."""

    config: str
    within: Sequence[str]


def main() -> NoReturn:
    """List the queryables of a network until standard input ends, or until its router is gone."""
    with contextlib.suppress(OSError):  # netem's threads may have a real-time class
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    settings = Settings(**json.loads(sys.stdin.readline()))
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        _list(settings)
    except (zenoh.ZError, TimeoutError, OSError) as error:
        print(error, file=sys.stderr, flush=True)  # noqa: T201
    os._exit(1)  # closing a deadlocked session would never end


def _list(settings: Settings) -> None:
    session, closed = _open(zenoh.Config.from_json5(settings.config))
    routers = session.info.routers_zid()
    _held = [session.declare_querier(key, target=zenoh.QueryTarget.ALL) for key in settings.within]
    # a router answers in order: this answer comes after the declarations of all queryables
    if any(reply.ok is None for reply in session.liveliness().get(_UNUSED_KEY, timeout=_ANSWER_S)):
        raise TimeoutError("the router does not answer")
    print(flush=True)  # noqa: T201  (from here on, silence means a deadlock)
    last: list[str] | None = None
    while routers and session.info.routers_zid() == routers:
        began_s = time.thread_time()
        keys = _read(session, settings.within, closed)
        print("" if keys == last else json.dumps(keys), flush=True)  # noqa: T201
        last = keys
        time.sleep(min(max(_PAUSE_S, _PAUSE_RATIO * (time.thread_time() - began_s)), _MAX_PAUSE_S))
    raise TimeoutError("the router is gone")


def _open(config: zenoh.Config) -> tuple[zenoh.Session, Closed]:
    """Open a session, through a valve if possible; return a context manager that closes the valve."""
    with valve_to(json.loads(config.get_json("connect/endpoints"))) as opened:
        if opened is None:
            return zenoh.open(config), contextlib.nullcontext
        endpoint, valves = opened
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("transport/link/protocols", '["unixsock-stream"]')
        session = zenoh.open(config)
        return session, valves[0].closed


def _read(session: zenoh.Session, within: Sequence[str], closed: Closed) -> list[str]:
    """Return the key expressions of the queryables that the router has declared to the session."""
    prefix = f"@/{session.zid()}/client/queryable/"
    found: set[str] = set()
    ends: list[threading.Event] = []

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            found.add(str(reply.ok.key_expr).removeprefix(prefix))

    signal.setitimer(signal.ITIMER_REAL, _MAX_READ_S)  # its signal ends this process
    with closed():
        for key in within:
            ends.append(threading.Event())
            # the replies arrive within the call; a Zenoh channel would be full after 256 of them, with no reader
            handler = zenoh.handlers.Callback(take, ends[-1].set, indirect=False)
            session.get(prefix + key, handler, consolidation=zenoh.ConsolidationMode.NONE, timeout=_ANSWER_S)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    if not all(end.wait(_ANSWER_S) for end in ends):  # the router is queried too, and answers with an end only
        raise TimeoutError("the router does not answer")
    return sorted(found)


def _end_with_input() -> NoReturn:
    while sys.stdin.buffer.read(1):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()
