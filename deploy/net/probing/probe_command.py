"""What ``tis net probe`` does: open its ends, send, write the trace, print what it says."""

import json
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from common.clocks.uncertainty import is_resolvable
from common.errors import EXIT_OK, DataError, Fault, PeerError
from common.runtime.zenoh_session import ZenohOptions
from common.trace_text import render_trace
from deploy.net.probing.delay_figures import PathFigures, path_figures
from deploy.net.probing.delay_figures import as_json as plain
from deploy.net.probing.ends import Ends, open_end, refuse_no_key
from deploy.net.probing.far_end import FarEnd
from deploy.net.probing.idle_relay import open_idle_relay
from deploy.net.probing.probe import Plan, Probed, probe
from deploy.net.probing.probe_trace import comparison, cut_short, trace_of
from deploy.net.probing.receiving_end import Ears
from deploy.net.tables import delay_doubts, print_path
from deploy.shell import run_dir as folder


def probe_and_print(
    ends: Ends, options: ZenohOptions, plan: Plan, target: Path | None, out: Console, err: Console, as_json: bool
) -> int:
    """Probe, write the trace to ``target`` and print its figures; raises `PeerError`, `DataError`."""
    if target is not None and not target.parent.is_dir():
        raise DataError(Fault(str(target), "", "must lie in a folder that exists"))
    refuse_no_key(plan.key, "tis net probe")
    began = datetime.now(UTC).isoformat(timespec="seconds")
    with ExitStack() as stack:
        if ends.far:
            sender = stack.enter_context(open_end(ends.sends_to, ends.listens, options, plan.wait_s, "probe"))
            far = FarEnd(sender, plan)
            stack.callback(far.close)
            far.meet()
            ears: FarEnd | Ears = far
        else:
            receiver = stack.enter_context(open_end(ends.receives_from, ends.listens, options, plan.wait_s, "probe"))
            sender = stack.enter_context(open_end(ends.sends_to, False, options, plan.wait_s, "probe"))
            ears = Ears(receiver, plan.key)
            stack.callback(ears.close)
        seconds = plan.n_messages / plan.rate_hz
        err.print(escape(f"tis: {plan.n_messages} messages on {plan.key}, {seconds:.3g} s"), soft_wrap=True)
        idle = stack.enter_context(open_idle_relay())
        probed = probe(sender, ears, plan)
        adds = None if idle is None else idle.spread()
    if isinstance(ears, FarEnd):
        ends = ends._replace(receives_from=f"far end on host {ears.host}")
        if ears.why_gone:
            err.print(escape(f"tis: warning: {cut_short(ears.why_gone, probed)}"), style="yellow", soft_wrap=True)
            if not len(probed.sent_ns):
                raise PeerError(
                    Fault("tis net probe", "--reflector", f"the far end {ears.why_gone}: nothing to keep")
                )
    label = "probe" if target is None else str(target)
    trace = trace_of(probed, label, ends, plan, began, adds)
    if isinstance(ears, FarEnd) and ears.why_gone:
        trace = replace(trace, about={**trace.about, "ended": cut_short(ears.why_gone, probed)})
    apart = not probed.clock.shared
    if target is not None:
        folder.write(target, render_trace(trace, probed.paired.uncertainty_ns if apart else None))
    figures = path_figures(trace)
    if as_json:
        paired = probed.paired
        counts = {"n_skipped": probed.n_skipped, "n_duplicates": paired.n_duplicates, "n_late": paired.n_late}
        doubts = _doubts(probed, figures) if apart else {}
        print(json.dumps({**plain(figures), **doubts, **counts, "about": dict(trace.about)}, indent=1))  # noqa: T201
    else:
        print_path(figures, out, probed)
        if ends.far:
            for what, said in comparison(probed).items():
                out.print(escape(f"{what.replace('_', ' ')}: {said}"), soft_wrap=True)
    if target is not None:
        err.print(escape(f"tis: written to {target}; `tis net fit {target}` makes a profile of it"), soft_wrap=True)
    return EXIT_OK


def _doubts(probed: Probed, figures: PathFigures) -> dict[str, Any]:
    doubts = delay_doubts(probed)
    unsure = [name for name, doubt in doubts.items() if not is_resolvable(figures.delay_ms[name], doubt)]
    return {"uncertainty_ms": doubts, "not_resolvable": unsure, "n_impossible": probed.paired.n_impossible}
