"""Marks of outages, stalls, live changes and absences in a plot over run time."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from bokeh.models.annotations import BoxAnnotation
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from tis.deploy.present import plot_style as style
from tis.deploy.present.palette import AWAY, CHANGED, OUTAGE, STALL, Tone
from tis.deploy.report.subjects.network.disturbances import Disturbance

_MAX_MARKS: Final = 40
_TONES: Final[dict[str, Tone]] = {"outage": OUTAGE, "stall": STALL, "change": CHANGED, "absence": AWAY}
_NAMES: Final = {
    "outage": "outage", "stall": "stall", "change": "changed while running", "absence": "a side was away",
}  # fmt: skip


def marked(drawn: style.Figure | None, found: Sequence[Disturbance], x_range: Range1d) -> style.Figure | None:
    """Return a figure with the disturbances in each of its panels over ``x_range``, and their keys."""
    if drawn is None or not found:
        return drawn
    each = [panel for plot in drawn.plots for panel in plot.select({"type": figure}) if isinstance(panel, figure)]
    panels = {panel.id: panel for panel in each}
    kinds = [kind for kind in _TONES if any(one.kind == kind for one in found)]
    for panel in panels.values():
        if panel.x_range is x_range:
            for kind in kinds:
                mark_disturbances(panel, [one for one in found if one.kind == kind], _TONES[kind].light, 1.0)
    return replace(drawn, keys=(*drawn.keys, *(style.Key(_NAMES[kind], _TONES[kind], "bar") for kind in kinds)))


def mark_disturbances(panel: figure, found: Sequence[Disturbance], colour: str, alpha: float = 0.15) -> None:
    """Shade the time of each disturbance, with dashed ends unless nothing is sent; of very many the longest."""
    longest = sorted(found, key=lambda one: one.begin_s - one.end_s)[:_MAX_MARKS]
    for one in longest:
        panel.add_layout(
            BoxAnnotation(
                left=one.begin_s,
                right=one.end_s,
                fill_color=colour,
                fill_alpha=alpha,
                line_color=colour,
                line_alpha=min(2 * alpha, 1.0),
                line_dash="solid" if one.kind in ("outage", "stall") else "dashed",
                level="underlay",
            )
        )
