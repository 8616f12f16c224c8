"""Decided and realised delay of every message over time, with losses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from tis.common.channels import Direction
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.columns import Ints
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.palette import CHANGED, DIRECTIONS, OUTAGE, PALE, RED, STALL, STATES, Tone
from tis.deploy.present.thinning import column, evenly, evenly_and_largest
from tis.deploy.report.subjects.network.key_figures import Array, LinkColumns
from tis.netem.conditions.conditions import Span

TITLES: Mapping[Direction, str] = {
    "forward": "forward (surgeon to patient)",
    "feedback": "feedback (patient to surgeon)",
}
_MAX_SPANS = 2000
_CROWDED = 1500
_CHANGED_BY = "changed by timeline or control"


@dataclass(frozen=True)
class _Dots:
    """One direction's messages, all keys together."""

    sent_s: Array
    seq: Ints
    decided_ms: Array
    realised_ms: Array
    lost_s: Array


def delay_figure(
    links: Mapping[Direction, LinkColumns], x_range: Range1d, spans: Mapping[Direction, Sequence[Span]]
) -> style.Figure | None:
    """Draw a panel for each direction that carried or lost a message; None when none did.

    ``spans`` are the conditions in force; spans other than the plain condition are shaded.
    """
    dots = {direction: _dots(link) for direction, link in links.items()}
    used = {direction: link for direction, link in dots.items() if len(link.sent_s) or len(link.lost_s)}
    if not used:
        return None
    *_, last = used
    panels = [_panel(link, d, x_range, d == last, spans.get(d, ())) for d, link in used.items()]
    shades = _shades([span for d in used for span in spans.get(d, ())])
    keys = [style.Key("decided", PALE, "dot", toggles=True)]
    keys += [style.Key(f"realised, {direction}", DIRECTIONS[direction], "dot", toggles=True) for direction in used]
    if any(len(link.lost_s) for link in used.values()):
        keys.append(style.Key("lost", RED, "stroke", toggles=True))
    keys += [style.Key(name, tone, "bar") for name, tone in shades.items()]
    counts = ", ".join(f"{d}: {len(link.sent_s)} delivered, {len(link.lost_s)} lost" for d, link in used.items())
    return style.Figure(
        plots=(style.stacked(panels),),
        title="Delay over time",
        caption=_caption(used, bool(shades)),
        alt=f"Scatter charts of each message's delay in netem over run time. {counts}.",
        keys=tuple(keys),
    )


def _caption(used: Mapping[Direction, _Dots], has_shades: bool) -> str:
    text = (
        "A dot is a message, placed where it was offered to the network: pale is the delay that the models drew, "
        "dark the delay that was measured. A dark dot above its pale one waited behind an earlier message, as in a "
        "queue; otherwise they coincide. A red stroke on the ground line is a message that was lost. "
    )
    parts = [
        f"{direction}: median {number(float(np.median(link.realised_ms)))} ms, max "
        f"{number(float(link.realised_ms.max()))} ms"
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


def _dots(link: LinkColumns) -> _Dots:
    order = np.argsort(link.all("sent_s"), kind="stable")
    sent_s, seq, decided_ms, realised_ms = (
        link.all(name)[order] for name in ("sent_s", "seq", "decided_ms", "realised_ms")
    )
    return _Dots(sent_s, seq.astype(np.int64), decided_ms, realised_ms, np.sort(link.all("lost_s")))


def _is_temporary(span: Span) -> bool:
    return span.outage or span.stall or span.changed or span.state is not None


def _shades(spans: Sequence[Span]) -> dict[str, Tone]:
    """Return names and tones of the temporary conditions that occur."""
    states = sorted({span.state for span in spans if span.state is not None})
    shades = {f"state {state}": STATES[i % len(STATES)] for i, state in enumerate(states)}
    if any(span.outage for span in spans):
        shades["outage"] = OUTAGE
    if any(span.stall and not span.outage for span in spans):
        shades["stall"] = STALL
    if any(span.changed and span.state is None and not span.outage and not span.stall for span in spans):
        shades[_CHANGED_BY] = CHANGED
    return shades


def _kind(span: Span) -> str:
    name = _CHANGED_BY if span.state is None else f"state {span.state}"
    return "outage" if span.outage else "stall" if span.stall else name


def _shade(panel: figure, spans: Sequence[Span], low: float, high: float) -> None:
    """Shade the spans of temporary conditions; of very many spans the longest."""
    longest = sorted(filter(_is_temporary, spans), key=lambda span: span.begin_ns - span.end_ns)[:_MAX_SPANS]
    for name, tone in _shades(spans).items():
        found = [span for span in longest if _kind(span) == name]
        source = ColumnDataSource(
            {
                "left": column([span.begin_ns / NS_PER_S for span in found]),
                "right": column([span.end_ns / NS_PER_S for span in found]),
            }
        )
        panel.quad(
            "left", "right", low, high, source=source, fill_color=tone.light, line_color=None, level="underlay"
        )


def _panel(link: _Dots, direction: Direction, x_range: Range1d, with_axis: bool, spans: Sequence[Span]) -> figure:
    panel = style.time_figure(x_range, "delay, ms", 240, with_axis)
    panel.title = TITLES[direction]
    highest_ms = max((float(ms.max()) for ms in (link.decided_ms, link.realised_ms) if len(ms)), default=0.0) or 1.0
    low, high = -0.08 * highest_ms, 1.08 * highest_ms
    panel.y_range = Range1d(start=low, end=high)
    if any(map(_is_temporary, spans)):
        _shade(panel, spans, low, high)
    kept = evenly_and_largest(link.realised_ms)
    source = ColumnDataSource(
        {
            "t": column(link.sent_s[kept]),
            "seq": link.seq[kept].astype(np.int32),
            "decided": column(link.decided_ms[kept]),
            "realised": column(link.realised_ms[kept]),
        }
    )
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
            source=ColumnDataSource({"t": column(lost_s)}),
            line_color=RED.light,
            line_width=1 if len(lost_s) > _CROWDED // 5 else 1.5,
            line_alpha=0.45 if len(lost_s) > _CROWDED // 5 else 1.0,
        )
        style.named("lost", [strokes])
    tips = [
        ("offered at", "@t{0.000} s"),
        ("number", "@seq"),
        ("decided", "@decided{0.000} ms"),
        ("realised", "@realised{0.000} ms"),
    ]
    panel.add_tools(HoverTool(renderers=[realised], tooltips=tips))
    return panel
