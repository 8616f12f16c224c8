"""Command ``tis net probe``: opens the ends, probes, writes the trace and prints the standards' figures."""

import json
import platform
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zenoh
from numpy.typing import NDArray
from rich.console import Console
from rich.markup import escape

from tis.common.clocks import PPM
from tis.common.errors import EXIT_OK, Fault, PeerError
from tis.common.metrics.delay_variation import (
    inter_packet_delay_variation_ns,
    packet_delay_variation_ns,
    rtp_jitter_ns,
)
from tis.common.metrics.loss import GilbertFit, fit_gilbert, loss_runs
from tis.common.metrics.percentiles import TAIL, Summary, is_resolvable, summarise, uncertainties
from tis.common.runtime.process import command_line
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.common.trace import Trace, render_trace
from tis.common.units import NS_PER_MS
from tis.deploy.net.ends import Ends, check_key, open_end
from tis.deploy.net.far_end import FarEnd
from tis.deploy.net.idle_relay import open_idle_relay
from tis.deploy.net.probe import LocalReceivingEnd, Plan, Probed, probe
from tis.deploy.present.numbers import known
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs, print_warnings
from tis.netem.fit.direction import steady_reason
from tis.netem.fit.half_life import HalfLife, fit_half_life
from tis.netem.fit.record import MEASURING_ADDS, Spread, measuring_adds

Nanoseconds = NDArray[np.int64]


class Variation(NamedTuple):
    """Delay variation in ms of the messages that arrived; None for too few.

    ``pdv_p99``: p99 less the minimum (RFC 5481); ``ipdv_p50`` and ``ipdv_p99`` of the absolute difference of
    neighbours that both arrived (RFC 3393); ``rtp_jitter``: the smoothed jitter of RFC 3550 at the record's end.
    """

    pdv_p99: float | None
    ipdv_p50: float | None
    ipdv_p99: float | None
    rtp_jitter: float | None


class PathFigures(NamedTuple):
    """Figures of a record: ``delay_ms`` has mean, std, p50 .. p99.9, max."""

    n: int
    n_lost: int
    delay_ms: Summary
    variation: Variation
    losses: GilbertFit
    n_runs: int
    longest_run: int
    half_life: HalfLife
    n_overtaken: int


def path_figures(trace: Trace) -> PathFigures:
    """Compute the figures of a record (oracle: by hand, tests/deploy/net/test_probe_command)."""
    lost = trace.delay_ns < 0
    sent_ns, delay_ns = trace.sent_ns[~lost], trace.delay_ns[~lost]
    arrived_ns = sent_ns + delay_ns
    runs = loss_runs(lost)
    steady = steady_reason(delay_ns, measuring_adds(trace)) if len(delay_ns) else ""
    return PathFigures(
        n=len(lost),
        n_lost=int(lost.sum()),
        delay_ms=summarise(delay_ns / NS_PER_MS, TAIL, ("mean", "std", "max")),
        variation=_variation(trace.sent_ns, trace.delay_ns, ~lost),
        losses=fit_gilbert(lost),
        n_runs=runs.n_runs,
        longest_run=runs.longest,
        half_life=HalfLife(None, None, None, steady) if steady else fit_half_life(sent_ns, delay_ns),
        n_overtaken=int(np.count_nonzero(arrived_ns < np.maximum.accumulate(arrived_ns))),
    )


def plain_figures(figures: PathFigures) -> dict[str, Any]:
    """Return the figures as plain values."""
    return {
        **figures._asdict(),
        "variation": figures.variation._asdict(),
        "losses": figures.losses._asdict(),
        "half_life": figures.half_life._asdict(),
    }


def _variation(sent_ns: Nanoseconds, delay_ns: Nanoseconds, arrived: NDArray[np.bool_]) -> Variation:
    sent_in_ns, came_in_ns = sent_ns[arrived], (sent_ns + delay_ns)[arrived]
    order = np.argsort(came_in_ns, kind="stable")
    jitter_ns = rtp_jitter_ns(sent_in_ns[order], came_in_ns[order])
    spread = summarise(packet_delay_variation_ns(delay_ns[arrived]) / NS_PER_MS, (99,), ())
    steps = summarise(np.abs(inter_packet_delay_variation_ns(delay_ns, arrived)) / NS_PER_MS, (50, 99), ())
    jitter = float(jitter_ns[-1]) / NS_PER_MS if len(jitter_ns) else None
    return Variation(spread["p99"], steps["p50"], steps["p99"], jitter)


def trace_of(probed: Probed, label: str, ends: Ends, plan: Plan, began: str, adds: Spread | None = None) -> Trace:
    """Return the probe's result as a trace with its conditions; raises `DataError` without any arrival.

    ``adds`` is the spread of the delays of an idle relay within the probing process.
    """
    about = {
        "what": "delay of Zenoh messages, from before put to the subscriber's callback; one way"
        + ("" if ends.far else ", provided that 'to' is reached without crossing the path, else there and back"),
        "from": ends.sends_to,
        "to": ends.receives_from,
        "host": platform.node(),
        "began": began,
        **(comparison(probed) if ends.far else {"clock": "same process, monotonic"}),
        "key": plan.key,
        "rate_hz": f"{plan.rate_hz:g}",
        "payload_bytes": str(plan.n_bytes),
        "timeout_s": f"{plan.timeout_s:g}",
        "skipped": str(probed.n_skipped),
        **({} if adds is None else {MEASURING_ADDS: adds.words}),
        "versions": f"eclipse-zenoh {version('eclipse-zenoh')}, "
        f"python {platform.python_version()}, {platform.system()} {platform.release()}",
    }
    return Trace(label, probed.sent_ns, probed.paired.delay_ns, about)


def comparison(probed: Probed) -> dict[str, str]:
    """Return method and result of the comparison of the sender's clock with the far end's."""
    if probed.clock.shared:
        return {"clock": "shared: both ends are on one host (equal boot ids), exact"}
    shortest_ms = int(probed.exchanges.round_trip_ns.min()) / NS_PER_MS
    offset_ms = float(probed.clock.offset_at(probed.exchanges.asked_ns[:1])[0]) / NS_PER_MS
    drift_ppm, open_ppm = probed.clock.drift / PPM, probed.clock.drift_bound / PPM
    most_ms = int(probed.paired.uncertainty_ns.max(initial=0)) / NS_PER_MS
    return {
        "clock": f"compared by {len(probed.exchanges)} exchanges over the same path, shortest round trip "
        f"{shortest_ms:.6g} ms; each bounds the offset to half its round trip, and so to an unequal path",
        "clock_offset": f"far end ahead by {offset_ms:.6f} ms at the first exchange",
        "clock_drift": f"far end gains {drift_ppm:.4g} ± {open_ppm:.4g} ppm",
        "uncertainty": f"± {most_ms:.6g} ms at most, a bound",
    }


def cut_short(why: str, probed: Probed) -> str:
    """Return a text on the remaining part of a probe whose far end became unavailable."""
    return (
        f"the far end {why}: {len(probed.sent_ns)} messages up to the last one known to have arrived are kept, "
        f"{probed.n_unknown} later ones do not count"
    )


def print_path(figures: PathFigures, out: Console, probed: Probed) -> None:
    """Print a record's figures, with the counts of the probe."""
    low, high = figures.losses.p_loss_interval
    share = 100 * figures.n_lost / figures.n
    out.print(
        f"{figures.n} messages, {figures.n - figures.n_lost} arrived, {figures.n_lost} lost: {share:.4g} % "
        f"(95 %: {100 * low:.4g} to {100 * high:.4g})"
    )
    if figures.n_runs:
        out.print(
            f"runs of losses {figures.n_runs}, mean {known(figures.losses.mean_burst)}, longest {figures.longest_run}"
        )
    uncertainty = {} if probed.clock.shared else delay_uncertainties(probed)
    delay = ", ".join(f"{name} {_figure(value, uncertainty.get(name))}" for name, value in figures.delay_ms.items())
    out.print(f"delay, ms: {delay}")
    varied = figures.variation
    out.print(
        f"variation, ms: PDV p99 {known(varied.pdv_p99)} (RFC 5481), IPDV p50 {known(varied.ipdv_p50)}, p99 "
        f"{known(varied.ipdv_p99)} (RFC 3393), jitter {known(varied.rtp_jitter)} (RFC 3550)"
    )
    out.print(f"correlation: {figures.half_life.words}")
    if figures.n_overtaken:
        out.print(f"overtaken by a later message: {figures.n_overtaken}")
    counts = {
        "duplicates": probed.paired.n_duplicates,
        "arrived after the timeout": probed.paired.n_late,
        "skipped, their send instant had passed": probed.n_skipped,
        "foreign messages on the key": probed.paired.n_foreign,
        "arrived before they were sent, because a clock was set": probed.paired.n_impossible,
    }
    for what, n in counts.items():
        if n:
            out.print(f"{what}: {n}")


def delay_uncertainties(probed: Probed) -> Summary:
    """Return the uncertainty of each delay figure, ms; none for ``std``, which an offset does not change."""
    arrived = probed.paired.delay_ns >= 0
    delay_ms, uncertainty_ms = (
        ns[arrived] / NS_PER_MS for ns in (probed.paired.delay_ns, probed.paired.uncertainty_ns)
    )
    return uncertainties(delay_ms, uncertainty_ms, TAIL, ("mean", "max"))


def _figure(value: float | None, uncertainty_ms: float | None) -> str:
    if uncertainty_ms is None:
        return known(value)
    remark = "" if is_resolvable(value, uncertainty_ms) else " (not resolvable)"
    return f"{known(value)} ± {known(uncertainty_ms)}{remark}"


def probe_and_print(
    ends: Ends, options: ZenohOptions, plan: Plan, target: Path | None, out: Console, err: Console, as_json: bool
) -> int:
    """Probe, write the trace to ``target`` and print its figures; raises `PeerError`, `DataError`."""
    check_outputs(target)
    check_key(plan.key, "tis net probe")
    began = datetime.now(UTC).isoformat(timespec="seconds")
    with ExitStack() as stack:
        sender, receiver = _open_ends(stack, ends, options, plan)
        seconds = plan.n_messages / plan.rate_hz
        err.print(escape(f"tis: {plan.n_messages} messages on {plan.key}, {seconds:.3g} s"), soft_wrap=True)
        idle_relay = stack.enter_context(open_idle_relay())
        probed = probe(sender, receiver, plan)
        adds = None if idle_relay is None else idle_relay.spread()
    ended: dict[str, str] = {}
    if isinstance(receiver, FarEnd):
        ends = ends._replace(receives_from=f"far end on host {receiver.host}")
        ended = _early_end(receiver, probed, err)
    trace = trace_of(probed, "probe" if target is None else str(target), ends, plan, began, adds)
    trace = replace(trace, about={**trace.about, **ended})
    if target is not None:
        uncertainty_ns = None if probed.clock.shared else probed.paired.uncertainty_ns
        folder.write(target, render_trace(trace, uncertainty_ns))
    if as_json:
        print(json.dumps(_json_figures(probed, trace), indent=1))  # noqa: T201
    else:
        print_path(path_figures(trace), out, probed)
        for name, text in comparison(probed).items() if ends.far else ():
            out.print(escape(f"{name.replace('_', ' ')}: {text}"), soft_wrap=True)
    if target is not None:
        fit = command_line(["net", "fit", str(target)])
        err.print(escape(f"tis: written to {target}; `{fit}` makes a profile of it"), soft_wrap=True)
    return EXIT_OK


def _open_ends(
    stack: ExitStack, ends: Ends, options: ZenohOptions, plan: Plan
) -> tuple[zenoh.Session, FarEnd | LocalReceivingEnd]:
    """Open the sending session and the receiving end until the end of ``stack``; raises `PeerError`."""
    if ends.far:
        sender = stack.enter_context(open_end(ends.sends_to, ends.listens, options, plan.wait_s, "probe"))
        far_end = FarEnd(sender, plan)
        stack.callback(far_end.close)
        far_end.meet()
        return sender, far_end
    # the receiving end first: it may be the router that the sending end connects to
    session = stack.enter_context(open_end(ends.receives_from, ends.listens, options, plan.wait_s, "probe"))
    sender = stack.enter_context(open_end(ends.sends_to, False, options, plan.wait_s, "probe"))
    local_end = LocalReceivingEnd(session, plan.key)
    stack.callback(local_end.close)
    return sender, local_end


def _early_end(far_end: FarEnd, probed: Probed, err: Console) -> dict[str, str]:
    """Warn of a far end that became unavailable; return the header field. Raises `PeerError` without messages."""
    if not far_end.failure:
        return {}
    text = cut_short(far_end.failure, probed)
    print_warnings(err, text)
    if not len(probed.sent_ns):
        raise PeerError(Fault("tis net probe", "--reflector", f"the far end {far_end.failure}: nothing to keep"))
    return {"ended": text}


def _json_figures(probed: Probed, trace: Trace) -> dict[str, Any]:
    """Return what ``--json`` prints; uncertainties only for ends on two clocks."""
    figures, paired = path_figures(trace), probed.paired
    fields = plain_figures(figures)
    if not probed.clock.shared:
        uncertainty_ms = delay_uncertainties(probed)
        unsure = [name for name, ms in uncertainty_ms.items() if not is_resolvable(figures.delay_ms[name], ms)]
        fields |= {"uncertainty_ms": uncertainty_ms, "not_resolvable": unsure, "n_impossible": paired.n_impossible}
    counts = {"n_skipped": probed.n_skipped, "n_duplicates": paired.n_duplicates, "n_late": paired.n_late}
    return {**fields, **counts, "about": dict(trace.about)}
