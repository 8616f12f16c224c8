"""Burstiness of losses: runs of lost messages by length."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.formatters import NumeralTickFormatter
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool

from tis.common.channels import Direction
from tis.deploy.logs.read.load import Ints
from tis.deploy.report.palette import DIRECTIONS
from tis.deploy.report.plots import plot_style as style
from tis.deploy.report.plots.packets import LinkColumns, run_lengths
from tis.deploy.report.plots.thinning import column

_MAX_UNBINNED: Final = 40
_GROUND: Final = 0.5


def loss_figure(links: Mapping[Direction, LinkColumns]) -> style.Figure | None:
    """Draw the number of runs of each length, per direction, all keys together; None without losses."""
    used = run_lengths(links)
    if not used:
        return None
    longest = max(int(lengths.max()) for lengths in used.values())
    width = max(1, -(-longest // _MAX_UNBINNED))
    counts = {direction: _binned(lengths, width) for direction, lengths in used.items()}
    most = max(int(n.max()) for _, n in counts.values())
    fig = style.plain_figure(
        300,
        x_axis_label="messages lost one after the other",
        y_axis_label="runs",
        y_axis_type="log",  # keeps a single long burst visible beside hundreds of single losses
        y_range=Range1d(start=_GROUND, end=1.3 * most),
    )
    fig.yaxis.ticker = [base * 10**power for power in range(1 + len(str(most))) for base in (1, 2, 5)]
    fig.yaxis.formatter = NumeralTickFormatter(format="0")
    if longest <= 12:
        fig.xaxis.ticker = list(range(1, longest + 1))
    share = 0.8 * width / len(used)
    for i, (direction, (first, n)) in enumerate(counts.items()):
        left = first - 0.4 * width + i * share + 0.5 * (width - 1)
        source = ColumnDataSource(
            {
                "left": column(left),
                "right": column(left + share),
                "runs": n.astype(np.int32),
                "length": [f"{low}" if width == 1 else f"{low} to {low + width - 1}" for low in first.tolist()],
            }
        )
        colour = DIRECTIONS[direction].light
        bars = fig.quad("left", "right", _GROUND, "runs", source=source, fill_color=colour, line_color=None)
        fig.add_tools(HoverTool(renderers=[bars], tooltips=[("lost in a row", "@length"), ("runs", "@runs")]))
    counts_of = ", ".join(f"{d} {len(r)} runs, the longest of {r.max()}" for d, r in used.items())
    return style.Figure(
        plots=(fig,),
        title="How losses are bunched",
        caption="A bar counts the runs of consecutive lost messages of that length, key by key. Independent losses "
        f"are mostly single; bars far to the right are bursts and outages, which an estimator must bridge. Here "
        f"{counts_of}.",
        alt=f"Histogram of the lengths of loss runs: {counts_of}.",
        keys=tuple(style.Key(direction, DIRECTIONS[direction], "bar") for direction in used),
    )


def _binned(lengths: Ints, width: int) -> tuple[Ints, Ints]:
    """Return the shortest length of each non-empty bin, and its number of runs."""
    bins, n = np.unique((lengths - 1) // width, return_counts=True)
    return bins * width + 1, n
