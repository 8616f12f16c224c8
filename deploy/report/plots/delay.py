"""Decided and realised delay of every message over time, with losses."""

from collections.abc import Mapping, Sequence

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from tis.common.channels import Direction
from tis.common.metrics.percentiles import median
from tis.common.units import NS_PER_S
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.palette import CHANGED, DIRECTIONS, OUTAGE, PALE, RED, STALL, STATES, Tone
from tis.deploy.present.thinning import evenly, evenly_and_largest
from tis.deploy.report.subjects.network.key_figures import LinkColumns
from tis.netem.conditions.conditions import Span

TITLES: Mapping[Direction, str] = {
    "forward": "forward (surgeon to patient)",
    "feedback": "feedback (patient to surgeon)",
}
_MAX_SPANS = 2000
_CROWDED = 1500
_CHANGED_BY = "changed by timeline or control"


def delay_figure(
    links: Mapping[Direction, LinkColumns],
    x_range: Range1d,
    spans: Mapping[Direction, Sequence[Span]],
    titles: Mapping[Direction, str] = TITLES,
) -> style.Figure | None:
    """Draw a panel for each direction that carried or lost a message; None when none did.

    ``titles`` are those of the panels; ``spans`` of conditions other than the plain one are shaded.
    """
    used = {direction: link for direction, link in links.items() if len(link.sent_s) or len(link.lost_s)}
    if not used:
        return None
    panels = [_panel(link, d, titles[d], x_range, spans.get(d, ())) for d, link in used.items()]
    shades = _shades([span for d in used for span in spans.get(d, ())])
    keys = [style.Key("decided", PALE, "dot", toggles=True)]
    keys += [style.Key(f"realised, {direction}", DIRECTIONS[direction], "dot", toggles=True) for direction in used]
    if any(len(link.lost_s) for link in used.values()):
        keys.append(style.Key("lost", RED, "stroke", toggles=True))
    keys += [style.Key(name, tone, "bar") for name, tone in shades.items()]
    counts = ", ".join(f"{d}: {len(link.sent_s)} delivered, {len(link.lost_s)} lost" for d, link in used.items())
    return style.Figure(
        plots=tuple(panels),
        title="Delay over time",
        caption=_caption(used, bool(shades)),
        alt=f"Scatter charts of each message's delay in netem over run time. {counts}.",
        keys=tuple(keys),
    )


def _caption(used: Mapping[Direction, LinkColumns], has_shades: bool) -> str:
    text = (
        "A dot is a message, placed where it was offered to the network: pale is the delay that the models drew, "
        "dark the delay that was measured. A dark dot above its pale one waited behind an earlier message, as in a "
        "queue; otherwise they coincide. A red stroke on the ground line is a message that was lost. "
    )
    parts = [
        f"{direction}: median {number(median(link.realised_ms))} ms, max {number(float(link.realised_ms.max()))} ms"
        for direction, link in used.items()
        if len(link.realised_ms)
    ]
    if parts:
        text += f"Here {'; '.join(parts)}. "
    if has_shades:
        text += "Shaded: temporary conditions. "
    if any(len(evenly_and_largest(link.realised_ms)) < len(link.sent_s) for link in used.values()):
        text += "Of these messages only some are drawn: evenly spaced ones, and the most delayed."
    return text.strip()


def _kind(span: Span) -> str:
    """Return the name of a temporary condition; "" for the plain one."""
    if span.outage or span.stall:
        return "outage" if span.outage else "stall"
    return f"state {span.state}" if span.state is not None else _CHANGED_BY if span.changed else ""


def _shades(spans: Sequence[Span]) -> dict[str, Tone]:
    """Return names and tones of the temporary conditions that occur."""
    states = sorted({span.state for span in spans if span.state is not None})
    tones = {f"state {state}": STATES[i % len(STATES)] for i, state in enumerate(states)}
    tones |= {"outage": OUTAGE, "stall": STALL, _CHANGED_BY: CHANGED}
    found = set(map(_kind, spans))
    return {name: tone for name, tone in tones.items() if name in found}


def _shade(panel: figure, spans: Sequence[Span], low: float, high: float) -> None:
    """Shade the spans of temporary conditions; of very many spans the longest."""
    longest = sorted(filter(_kind, spans), key=lambda span: span.begin_ns - span.end_ns)[:_MAX_SPANS]
    for name, tone in _shades(spans).items():
        found = [span for span in longest if _kind(span) == name]
        ends = ([getattr(span, end) / NS_PER_S for span in found] for end in ("begin_ns", "end_ns"))
        source = style.data(**dict(zip(("left", "right"), ends, strict=True)))
        panel.quad(
            "left", "right", low, high, source=source, fill_color=tone.light, line_color=None, level="underlay"
        )


def _panel(link: LinkColumns, direction: Direction, title: str, x_range: Range1d, spans: Sequence[Span]) -> figure:
    panel = style.time_figure(x_range, "delay, ms", 240)
    panel.title = title
    highest_ms = max((float(ms.max()) for ms in (link.decided_ms, link.realised_ms) if len(ms)), default=0.0) or 1.0
    low, high = -0.08 * highest_ms, 1.08 * highest_ms
    panel.y_range = Range1d(start=low, end=high)
    _shade(panel, spans, low, high)
    kept = evenly_and_largest(link.realised_ms)
    seq, drawn_ms = link.seq[kept].astype(np.int32), (link.decided_ms[kept], link.realised_ms[kept])
    source = style.data(t=link.sent_s[kept], seq=seq, decided=drawn_ms[0], realised=drawn_ms[1])
    # crowded panels get smaller dots and thinner strokes
    shrink = 0.7 if len(kept) > _CROWDED else 1.0
    decided = panel.scatter("t", "decided", source=source, size=7 * shrink, fill_color=PALE.light, line_color=None)
    realised = panel.scatter(
        "t", "realised", source=source, size=3.5 * shrink, fill_color=DIRECTIONS[direction].light, line_color=None
    )
    style.named("decided", [decided])
    style.named(f"realised, {direction}", [realised])
    if len(link.lost_s):
        lost_s = link.lost_s[evenly(len(link.lost_s))]
        strokes = panel.segment(
            "t",
            0.75 * low,
            "t",
            -0.25 * low,
            source=style.data(t=lost_s),
            line_color=RED.light,
            line_width=1 if len(lost_s) > _CROWDED // 5 else 1.5,
            line_alpha=0.45 if len(lost_s) > _CROWDED // 5 else 1.0,
        )
        style.named("lost", [strokes])
    delays = ((name, f"@{name}{{0.000}} ms") for name in ("decided", "realised"))
    style.hover(panel, realised, ("offered at", "@t{0.000} s"), ("number", "@seq"), *delays)
    return panel
