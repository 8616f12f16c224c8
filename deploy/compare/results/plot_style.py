"""Common style of a comparison's matplotlib figures: an estimator has the look that it has in reports."""

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes

from deploy.report.palette import look_of

_MARKERS: Final = "os^vDPX<>"
_DASHES: Final = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}


def tone(name: str, names: Sequence[str]) -> str:
    """Return the colour of one estimator of several."""
    return look_of(name, names).tone.light


def draw_line(axes: Axes, name: str, names: Sequence[str], x: Sequence[float], y: Sequence[float]) -> None:
    """Draw the line of one estimator of several."""
    dash, marker = _DASHES[look_of(name, names).dash], _MARKERS[list(names).index(name) % len(_MARKERS)]
    colour = tone(name, names)
    axes.plot(x, y, color=colour, linestyle=dash, marker=marker, markersize=3.5, linewidth=1.0, label=name)
