"""Command ``tis net reflect``: far end of probes until a signal ends it."""

import signal
from contextlib import ExitStack
from threading import Event

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.deploy.net.probing.ends import check_key, open_end
from tis.deploy.net.probing.probe import low_latency
from tis.deploy.net.probing.reflector import Reflector

_WHERE = "tis net reflect"


def run_reflector(
    connect: str | None, listen: str | None, options: ZenohOptions, key: str, wait_s: float, err: Console
) -> int:
    """Stamp messages and return the stamps until SIGINT or SIGTERM; raises `PeerError`, `InputError`."""
    check_key(key, _WHERE)
    endpoint = connect or listen
    if endpoint is None or (connect and listen):
        raise InputError(Fault(_WHERE, "--listen", "or --connect is required, but not both"))
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with ExitStack() as stack:
        session = stack.enter_context(open_end(endpoint, connect is None, options, wait_s, "reflect"))
        reflector = Reflector(session, key)
        stack.callback(reflector.close)
        err.print(escape(f"tis: far end of probes on {key}, at {endpoint}; Ctrl-C ends it"), soft_wrap=True)
        with low_latency():
            reflector.serve(stop.is_set)
    err.print(f"tis: {reflector.n_received} messages stamped")
    return EXIT_OK
