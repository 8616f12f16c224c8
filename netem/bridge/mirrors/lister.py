"""A process that tells which queryables a network has: a Zenoh client that reads what its router has told it.

It reads its own admin space, never a router's. Up to Zenoh 1.10 an answer of the admin space takes the lock of the
routing tables twice; when anybody declares something in between, they stay locked for ever (zenoh's pull request
2619). A valve keeps others' declarations back meanwhile (`netem.bridge.mirrors.valve`), where the way to the router
is a plain socket. If it stands still none the less, it is this process alone: an alarm ends it, and
`netem.bridge.mirrors.listing` starts another.

Standard input brings one line (`Asked` as JSON), and its end is the end of this process. Standard output takes a line
for each reading: the keys as JSON where they have changed, else an empty one, as a sign of life; an empty one first.
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

from netem.bridge.mirrors.valve import valve_to

_PAUSE_S: Final = 0.1
_SHARE: Final = 20  # many queryables shall not eat up the processor
_LONGEST_PAUSE_S: Final = 0.5
_LONGEST_READ_S: Final = 0.5
_ANSWER_S: Final = 2.0
_NOBODY: Final = "@tis/netem/nobody"

Closed = Callable[[], AbstractContextManager[None]]


class Asked(NamedTuple):
    """The client's configuration (JSON), and the key expressions that queryables must share keys with."""

    config: str
    within: Sequence[str]


def main() -> NoReturn:
    """Tell the queryables of a network until standard input ends, or until its router is gone."""
    with contextlib.suppress(OSError):  # the threads of netem that start this one may be of a higher class
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    asked = Asked(**json.loads(sys.stdin.readline()))
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        _tell(asked)
    except (zenoh.ZError, TimeoutError, OSError) as error:
        print(error, file=sys.stderr, flush=True)  # noqa: T201
    os._exit(1)  # closing a session that stands still would never end


def _tell(asked: Asked) -> None:
    session, closed = _open(zenoh.Config.from_json5(asked.config))
    routers = session.info.routers_zid()
    _held = [session.declare_querier(key, target=zenoh.QueryTarget.ALL) for key in asked.within]
    # a router answers in order: with this answer, it has told all queryables
    if any(reply.ok is None for reply in session.liveliness().get(_NOBODY, timeout=_ANSWER_S)):
        raise TimeoutError("the router does not answer")
    print(flush=True)  # noqa: T201  (from here on, silence means that it stands still)
    last: list[str] | None = None
    while routers and session.info.routers_zid() == routers:
        began_s = time.thread_time()
        keys = _read(session, asked.within, closed)
        print("" if keys == last else json.dumps(keys), flush=True)  # noqa: T201
        last = keys
        time.sleep(min(max(_PAUSE_S, _SHARE * (time.thread_time() - began_s)), _LONGEST_PAUSE_S))
    raise TimeoutError("the router is gone")


def _open(config: zenoh.Config) -> tuple[zenoh.Session, Closed]:
    """Open a session, by way of a valve where that can be; return what closes it for the length of a block."""
    with valve_to(json.loads(config.get_json("connect/endpoints"))) as way:
        if way is None:
            return zenoh.open(config), contextlib.nullcontext
        endpoint, valves = way
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("transport/link/protocols", '["unixsock-stream"]')
        session = zenoh.open(config)
        return session, valves[0].closed


def _read(session: zenoh.Session, within: Sequence[str], closed: Closed) -> list[str]:
    """Return the key expressions of the queryables that the session has been told of."""
    prefix = f"@/{session.zid()}/client/queryable/"
    found: set[str] = set()
    ends: list[threading.Event] = []

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            found.add(str(reply.ok.key_expr).removeprefix(prefix))

    signal.setitimer(signal.ITIMER_REAL, _LONGEST_READ_S)  # it ends this process
    with closed():
        for key in within:
            ends.append(threading.Event())
            # the answers come within the call, where a channel of Zenoh's would be full after 256 and never be read
            handler = zenoh.handlers.Callback(take, ends[-1].set, indirect=False)
            session.get(prefix + key, handler, consolidation=zenoh.ConsolidationMode.NONE, timeout=_ANSWER_S)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    if not all(end.wait(_ANSWER_S) for end in ends):  # the router is asked, too, and has nothing to say
        raise TimeoutError("the router does not answer")
    return sorted(found)


def _end_with_input() -> NoReturn:
    while sys.stdin.buffer.read(1):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()
