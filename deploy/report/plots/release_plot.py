"""Distribution of the release error of netem."""

from collections.abc import Mapping

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool

from tis.common.channels import Direction
from tis.deploy.report.palette import DIRECTIONS
from tis.deploy.report.plots import plot_style as style
from tis.deploy.report.plots.packets import LinkColumns
from tis.deploy.report.plots.thinning import column, distribution

_MIN_US = 1.0


def release_figure(links: Mapping[Direction, LinkColumns]) -> style.Figure | None:
    """Draw the share of packets above each release error; None in virtual time, which has no error."""
    errors = {direction: link.all("error_us") for direction, link in links.items()}
    used = {direction: error_us for direction, error_us in errors.items() if len(error_us) and error_us.any()}
    if not used:
        return None
    largest = max(float(error_us.max()) for error_us in used.values())
    most = max(len(error_us) for error_us in used.values())
    fig = style.plain_figure(
        300,
        x_axis_label="left later than decided by, \u00b5s",
        y_axis_label="share that left later still, %",
        x_axis_type="log",
        y_axis_type="log",
        x_range=Range1d(start=_MIN_US, end=2 * max(largest, 10 * _MIN_US)),
        y_range=Range1d(start=50 / most, end=130),
    )
    for direction, error_us in used.items():
        value, percent = distribution(np.maximum(error_us, _MIN_US))
        # steps down from 100 %; the last step would be 0, which a log axis cannot show
        above = np.maximum(100.0 - percent, 50 / most)
        source = ColumnDataSource({"value": column([_MIN_US, *value]), "above": column([100.0, *above])})
        colour = DIRECTIONS[direction].light
        line = fig.step("value", "above", source=source, mode="after", line_color=colour, line_width=2)
        tips = [("later than", "@value{0} \u00b5s"), ("share", "@above %")]
        fig.add_tools(HoverTool(renderers=[line], tooltips=tips))
    medians = ", ".join(f"{d}: median {np.median(e):.0f} \u00b5s" for d, e in used.items())
    return style.Figure(
        plots=(fig,),
        title="Release error",
        caption="The emulator decides an instant for each message and wakes up a little after it. Follow a curve to "
        "the right until it has fallen to 1 %: 99 of 100 messages left with at most that error (p99). A long tail "
        f"means that the machine was busy with something else. Here {medians}.",
        alt=f"Distribution of the release error on logarithmic axes. {medians}.",
        keys=tuple(style.Key(direction, DIRECTIONS[direction], "line") for direction in used),
    )
