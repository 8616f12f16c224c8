"""The arm's movement: its path in space with the estimates as ghosts, and its position along each axis over time."""

from typing import Final

import numpy as np
from bokeh.models.ranges import DataRange1d, Range1d

from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.thinning import Array
from tis.deploy.report.plots.scene_3d import TRAIL_S, ScenePath, camera_controls, scene
from tis.deploy.report.run_view import HandView

_SCENE_PX: Final = 330


def tracking_figure(view: HandView, x_range: Range1d) -> style.Figure | None:
    """Draw truth and estimates; None without ticks."""
    if not view.n_ticks:
        return None
    names = list(view.lines_m)
    styles = style.line_styles(names, view.active)
    panels = []
    for axis, height in (("x", 190), ("y", 160), ("z", 200)):
        panel = style.time_figure(x_range, f"{axis}, mm", height, axis == "z")
        panel.y_range = DataRange1d(only_visible=True)
        style.lines_over_time(panel, view.source, styles, axis, "{0.00} mm")
        panels.append(panel)
    return style.Figure(
        plots=(style.stacked(panels),),
        title=f"Position over time: {view.title}",
        caption=_caption(view),
        alt=f"Three line charts of the arm's x, y and z over run time: {', '.join(names)}. {range_text(view)}",
        keys=style.line_keys(styles),
    )


def range_text(view: HandView) -> str:
    """Return a sentence on the range of the arm's movement."""
    there = view.track.truth_m[np.isfinite(view.track.truth_m).all(axis=1)]
    if not len(there):
        return "The truth is not known."
    widths = " by ".join(f"{MM_PER_M * width_m:.0f}" for width_m in np.ptp(there, axis=0))
    return f"The arm moves over {widths} mm."


def _caption(view: HandView) -> str:
    text = "The thick line is the truth; an estimate is good where it covers that line. "
    if view.active in view.track.estimates and view.active != "hold":
        text += f"hold trails behind whenever the arm moves; {view.active} should not. "
    return text + range_text(view) + view.thinning_note()


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
        plots=(scene(name, view.source, _box(truth_mm), paths, height=_SCENE_PX),),
        title=f"Path in space: {view.title}",
        caption=_path_caption(view),
        alt=f"The arm's path in space, seen from a camera that can be turned. {range_text(view)}",
        keys=style.line_keys(styles),
        controls=camera_controls(name, float(view.track.t_ns[-1]) / NS_PER_S, _furthest_off_s(view)),
    )


def _box(truth_mm: Array) -> dict[str, Range1d]:
    """Return the range of the truth (T, 3) along each axis, at least a quarter of the widest, and `_MIN_SPAN_MM`."""
    low, high = np.nanmin(truth_mm, axis=0), np.nanmax(truth_mm, axis=0)
    half = np.maximum(high - low, max(_MIN_SPAN_MM, float((high - low).max()) / 4)) / 2
    middle = (low + high) / 2
    return {
        axis: Range1d(start=float(m - h), end=float(m + h)) for axis, m, h in zip("xyz", middle, half, strict=True)
    }


def _furthest_off_s(view: HandView) -> float:
    """Return the run time of hold's largest scored error, when ghosts and arm are furthest apart; 0 without one."""
    error_mm = view.scored(view.errors_mm, "hold")
    return float(view.track.t_ns[np.nanargmax(error_mm)]) / NS_PER_S if np.isfinite(error_mm).any() else 0.0


def _path_caption(view: HandView) -> str:
    others = " and ".join(dict.fromkeys(name for name in ("hold", view.active) if name in view.errors_mm))
    text = "Faint: the whole path, and below it its shadow on the floor of the box. "
    text += f"Marks: where the arm is at the slider's time, each with its last {TRAIL_S:g} s"
    text += f", and where {others} put it. " if others else ". "
    at_s = _furthest_off_s(view)
    if at_s:
        worst_mm = float(np.nanmax(view.errors_mm["hold"][view.track.scored]))
        text += f"The slider begins at {at_s:.1f} s, where hold is furthest off of all scored ticks, "
        text += f"by {number(worst_mm)} mm. "
    text += f"{range_text(view)} Drag the figure to turn it; zoomed in, it follows the arm."
    return text + view.thinning_note()
