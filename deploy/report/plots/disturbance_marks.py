"""Marks of outages and live changes in a plot over run time."""

from collections.abc import Sequence
from typing import Final

from bokeh.models.annotations import BoxAnnotation
from bokeh.plotting import figure

from deploy.report.measures.network.disturbances import Disturbance

_MAX_MARKS: Final = 40
_ALPHA: Final = 0.15


def mark_disturbances(panel: figure, found: Sequence[Disturbance], colour: str) -> None:
    """Shade the time of each disturbance; of very many the longest."""
    longest = sorted(found, key=lambda one: one.begin_s - one.end_s)[:_MAX_MARKS]
    for one in longest:
        panel.add_layout(
            BoxAnnotation(
                left=one.begin_s,
                right=one.end_s,
                fill_color=colour,
                fill_alpha=_ALPHA,
                line_color=colour,
                line_alpha=2 * _ALPHA,
                line_dash="solid" if one.kind == "outage" else "dashed",
                level="underlay",
            )
        )
