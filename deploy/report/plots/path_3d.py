"""Path of the arm in space, with the estimates as ghosts, at any time and from any side."""

from typing import Final

import numpy as np
from bokeh.models.ranges import Range1d

from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.report.plots import plot_style as style
from tis.deploy.report.plots.hand_view import HandView
from tis.deploy.report.plots.scene_3d import TRAIL_S, ScenePath, camera_controls, scene
from tis.deploy.report.plots.thinning import Array
from tis.deploy.report.plots.tracking_plot import range_text
from tis.deploy.report.tables.numbers import number

_MIN_SPAN_MM: Final = 1.0
_MAX_WIDTH: Final = 3.0
_MARKERS: Final = {"truth": ("circle", 14), "hold": ("square", 11)}
_OTHER: Final = ("diamond", 15)


def path_figure(view: HandView) -> style.Figure | None:
    """Draw truth and estimates in space, with a camera, a time slider and a play button; None without truth."""
    truth_mm = MM_PER_M * view.track.truth_m
    if not np.isfinite(truth_mm).all(axis=1).any():
        return None
    name = f"path-{view.hand}"
    view.source.name = f"{name}-track"
    styles = style.line_styles(list(view.lines_m), view.active)
    paths = []
    for line, look in styles.items():
        columns = (f"{line} x", f"{line} y", f"{line} z")
        drawn = (*_MARKERS.get(line, _OTHER), min(look.width, _MAX_WIDTH), look.look.dash, look.shown)
        paths.append(ScenePath(line, columns, look.look.tone, *drawn))
    return style.Figure(
        plots=(scene(name, view.source, _box(truth_mm), paths),),
        title=f"Path in space: {view.title}",
        caption=_caption(view),
        alt=f"The arm's path in space, seen from a camera that can be turned. {range_text(view)}",
        keys=style.line_keys(styles),
        controls=camera_controls(name, float(view.track.t_ns[-1]) / NS_PER_S, _furthest_off_s(view)),
    )


def _box(truth_mm: Array) -> dict[str, Range1d]:
    """Return the range of the truth (T, 3) along each axis, at least `_MIN_SPAN_MM` wide."""
    low, high = np.nanmin(truth_mm, axis=0), np.nanmax(truth_mm, axis=0)
    half = np.maximum(high - low, _MIN_SPAN_MM) / 2
    middle = (low + high) / 2
    return {
        axis: Range1d(start=float(m - h), end=float(m + h)) for axis, m, h in zip("xyz", middle, half, strict=True)
    }


def _furthest_off_s(view: HandView) -> float:
    """Return the run time of hold's largest scored error, when ghosts and arm are furthest apart; 0 without one."""
    error_mm = np.where(view.track.scored, view.errors_mm.get("hold", np.nan), np.nan)
    return float(view.track.t_ns[np.nanargmax(error_mm)]) / NS_PER_S if np.isfinite(error_mm).any() else 0.0


def _caption(view: HandView) -> str:
    others = " and ".join(dict.fromkeys(name for name in ("hold", view.active) if name in view.errors_mm))
    text = "Faint: the whole path, and below it its shadow on the floor of the box. "
    text += f"Marks: where the arm is at the slider's time, each with its last {TRAIL_S:g} s"
    text += f", and where {others} put it. " if others else ". "
    at_s = _furthest_off_s(view)
    if at_s:
        worst_mm = float(np.nanmax(view.errors_mm["hold"][view.track.scored]))
        text += f"The slider begins at {at_s:.1f} s, where hold is furthest off, by {number(worst_mm)} mm. "
    text += f"{range_text(view)} Drag the figure to turn it; zoomed in, it follows the arm."
    return text + view.thinning_note()
