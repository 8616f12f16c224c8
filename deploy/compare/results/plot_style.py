"""Common style of a comparison's matplotlib figures: an estimator has the look that it has in reports."""

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes

from tis.deploy.present.palette import look_of

_MARKERS: Final = "os^vDPX<>"
_DASHES: Final = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}


def tone(name: str, names: Sequence[str]) -> str:
    """Return the colour of one estimator of several."""
    return look_of(name, names).tone.light


def draw_line(axes: Axes, name: str, names: Sequence[str], x: Sequence[float], y: Sequence[float]) -> None:
    """Draw the line of one estimator of several; where it is not solid, its markers are hollow."""
    look, marker = look_of(name, names), _MARKERS[list(names).index(name) % len(_MARKERS)]
    axes.plot(
        x,
        y,
        color=look.tone.light,
        linestyle=_DASHES[look.dash],
        linewidth=1.0,
        marker=marker,
        markersize=4.5,
        markerfacecolor=look.tone.light if look.dash == "solid" else "white",
        label=name,
    )
