"""Trace of a probe, with its conditions in the header."""

import platform
from importlib.metadata import version

from common.clocks.model import PPM
from common.trace import Trace
from common.units import NS_PER_MS
from deploy.net.probing.ends import Ends
from deploy.net.probing.probe import Plan, Probed
from netem.fit.measuring import MEASURING_ADDS, Spread


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
