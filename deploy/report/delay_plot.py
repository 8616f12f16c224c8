"""The delay of every message over time, decided and realised, and when messages were lost."""

import math
from collections.abc import Mapping

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models import ColumnDataSource
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from common.channels import Direction
from deploy.report import plot_style as style
from deploy.report.packets import LinkColumns
from deploy.report.thinning import evenly, evenly_and_largest

TITLES: Mapping[Direction, str] = {
    "forward": "forward (surgeon to patient)",
    "feedback": "feedback (patient to surgeon)",
}
COLOURS: Mapping[Direction, str] = {"forward": style.FORWARD, "feedback": style.FEEDBACK}


def delay_figure(links: Mapping[Direction, LinkColumns], x_range: Range1d) -> style.Figure | None:
    """Draw a panel for each direction that carried or lost a message; None when none did."""
    used = {direction: link for direction, link in links.items() if len(link.sent_s) or len(link.lost_s)}
    if not used:
        return None
    *_, last = used
    panels = [_panel(link, direction, x_range, direction == last) for direction, link in used.items()]
    says = (
        "A dot is a message, placed where it was offered to the network: pale is the delay that the models drew, "
        "dark the delay that was measured. A dark dot above its pale one waited behind an earlier message, as in a "
        "queue; otherwise they should coincide. A red stroke on the ground line is a message that was lost."
    )
    if any(len(evenly_and_largest(link.realised_ms)) < len(link.sent_s) for link in used.values()):
        says += " Of this many messages only some are drawn, evenly spaced, and the most delayed ones."
    counts = ", ".join(f"{d}: {len(link.sent_s)} delivered, {len(link.lost_s)} lost" for d, link in used.items())
    return style.Figure(
        plot=gridplot([[panel] for panel in panels], sizing_mode="stretch_width", toolbar_location="above"),
        title="Delay over time",
        says=says,
        alt=f"Scatter charts of each message's delay in netem over run time. {counts}.",
    )


def _panel(link: LinkColumns, direction: Direction, x_range: Range1d, with_axis: bool) -> figure:
    panel = style.time_figure(x_range, "delay, ms", 240, with_axis)
    panel.title = TITLES[direction]
    highest_ms = max(map(float, (*link.decided_ms, *link.realised_ms)), default=0.0) or 1.0
    panel.y_range = Range1d(start=-0.06 * highest_ms, end=1.08 * highest_ms)
    kept = evenly_and_largest(link.realised_ms)
    source = ColumnDataSource(
        {
            "t": style.column(link.sent_s[kept]),
            "seq": link.seq[kept].astype(np.int32),
            "decided": style.column(link.decided_ms[kept]),
            "realised": style.column(link.realised_ms[kept]),
        }
    )
    decided = panel.scatter(
        "t", "decided", source=source, size=8, fill_color=style.PALE, line_color=None, muted_fill_alpha=0
    )
    realised = panel.scatter(
        "t", "realised", source=source, size=3.5, fill_color=COLOURS[direction], line_color=None, muted_fill_alpha=0
    )
    entries = {"decided": [decided], "realised": [realised]}
    if len(link.lost_s):
        lost_s = link.lost_s[evenly(len(link.lost_s))]
        entries["lost"] = [
            panel.scatter(
                "t",
                "y",
                source=ColumnDataSource({"t": style.column(lost_s), "y": np.zeros(len(lost_s), dtype=np.float32)}),
                marker="dash",
                angle=0.5 * math.pi,
                size=10,
                line_color=style.LOST,
                line_width=1.5,
                muted_line_alpha=0,
            )
        ]
    tips = [
        ("offered at", "@t{0.000} s"),
        ("number", "@seq"),
        ("decided", "@decided{0.000} ms"),
        ("realised", "@realised{0.000} ms"),
    ]
    panel.add_tools(HoverTool(renderers=[realised], tooltips=tips))
    style.add_legend(panel, entries)
    return panel
