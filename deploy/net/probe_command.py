"""What ``tis net probe`` does: open both ends, send, write the trace, print what it says."""

import json
import platform
import time
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple, Self

import zenoh
from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_OK, DataError, Fault, InputError, PeerError
from common.runtime.zenoh_session import ZenohOptions, configure, open_client, open_router
from common.trace import Trace
from common.trace_text import render_trace
from deploy import run_dir as folder
from deploy.net.delay_figures import as_json as plain
from deploy.net.delay_figures import path_figures
from deploy.net.probe import Plan, Probed, probe
from deploy.net.tables import print_path


class Ends(NamedTuple):
    """Where the two ends of the probe are: the receiving one listens itself when ``listens``."""

    sends_to: str
    receives_from: str
    listens: bool = False

    @classmethod
    def of(cls, connect: str | None, from_end: str | None, to_end: str | None, listen: str | None) -> Self:
        """Return the ends that the options mean; raises `InputError` where one is missing or given twice."""
        if listen is not None:
            if connect is not None or to_end is not None:
                raise InputError(Fault("tis net probe", "--listen", "must not be given beside --connect or --to"))
            return cls(from_end or listen, listen, listens=True)
        sends, receives = from_end or connect, to_end or connect
        if sends is None or receives is None:
            missing = "--from" if sends is None else "--to"
            raise InputError(
                Fault(
                    "tis net probe",
                    missing,
                    "is required: both ends are in this process, since a one-way delay needs one clock; "
                    "between two hosts it cannot be measured yet",
                )
            )
        return cls(sends, receives)


def probe_and_print(
    ends: Ends, options: ZenohOptions, plan: Plan, target: Path | None, out: Console, err: Console, as_json: bool
) -> int:
    """Probe, write the trace to ``target`` and print its figures; raises `PeerError`, `DataError`."""
    if target is not None and not target.parent.is_dir():
        raise DataError(Fault(str(target), "", "must lie in a folder that exists"))
    try:
        zenoh.KeyExpr(plan.key)
    except zenoh.ZError:
        raise InputError(Fault("tis net probe", "--key", "must be a Zenoh key", plan.key)) from None
    if "*" in plan.key or "$" in plan.key:
        raise InputError(Fault("tis net probe", "--key", "must be one key, without wildcards", plan.key))
    began = datetime.now(UTC).isoformat(timespec="seconds")
    with ExitStack() as stack:
        receiver = stack.enter_context(_receiver(ends, options, plan))
        sender = stack.enter_context(_client(ends.sends_to, options, plan))
        seconds = plan.n_messages / plan.rate_hz
        err.print(escape(f"tis: {plan.n_messages} messages on {plan.key}, {seconds:.3g} s"), soft_wrap=True)
        probed = probe(sender, receiver, plan)
    label = "probe" if target is None else str(target)
    trace = trace_of(probed, label, ends, plan, began)
    if target is not None:
        folder.write(target, render_trace(trace))
    figures = path_figures(trace)
    if as_json:
        counts = {"n_skipped": probed.n_skipped, "n_duplicates": probed.n_duplicates, "n_late": probed.n_late}
        print(json.dumps({**plain(figures), **counts, "about": dict(trace.about)}, indent=1))  # noqa: T201
    else:
        print_path(figures, out, probed)
    if target is not None:
        err.print(escape(f"tis: written to {target}; `tis net fit {target}` makes a profile of it"), soft_wrap=True)
    return EXIT_OK


def trace_of(probed: Probed, label: str, ends: Ends, plan: Plan, began: str) -> Trace:
    """Return what was probed as a trace that says where, when and how; raises `DataError` when nothing came."""
    about = {
        "what": "delay of Zenoh messages, from before put to the subscriber's callback; one way, provided that 'to' "
        "is reached without crossing the path, else there and back",
        "from": ends.sends_to,
        "to": ends.receives_from,
        "host": platform.node(),
        "began": began,
        "clock": "same process, monotonic",
        "key": plan.key,
        "rate_hz": f"{plan.rate_hz:g}",
        "payload_bytes": str(plan.n_bytes),
        "timeout_s": f"{plan.timeout_s:g}",
        "skipped": str(probed.n_skipped),
        "versions": f"eclipse-zenoh {version('eclipse-zenoh')}, "
        f"python {platform.python_version()}, {platform.system()} {platform.release()}",
    }
    return Trace(label, probed.sent_ns, probed.delay_ns, about)


def _receiver(ends: Ends, options: ZenohOptions, plan: Plan) -> zenoh.Session:
    if not ends.listens:
        return _client(ends.receives_from, options, plan)
    return open_router(configure("router", replace(options, listen=[ends.receives_from])), ends.receives_from)


def _client(endpoint: str, options: ZenohOptions, plan: Plan) -> zenoh.Session:
    give_up = time.monotonic() + plan.wait_s
    config = configure("client", replace(options, connect=[endpoint]))
    session = open_client(config, lambda: time.monotonic() >= give_up, lambda: None)
    if session is None:
        raise PeerError(Fault("probe", endpoint, f"nobody answered within {plan.wait_s:g} s"))
    return session
