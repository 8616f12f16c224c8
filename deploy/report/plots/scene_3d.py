"""Scene in three dimensions: paths, a box around them, and the controls of the camera that looks at them.

Bokeh has no third dimension. ``present/camera.js`` projects the columns of a source onto the plane of the screen, in
the browser, for each position of the camera, so a page holds each path once. It finds its work by names and tags: the
figure's tag is the name of the source of the paths, its extra ranges are the box, and a renderer's tags are its part
of the scene, the path's name and the columns of x, y and z.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from bokeh.core.properties import value
from bokeh.models import ColumnDataSource
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from tis.deploy.present.palette import AXIS, PALE, PAPER, SOFT, Tone
from tis.deploy.present.plot_style import FONT, named

TRAIL_S: Final = 2.0
"""Length of the trail behind each head, in s."""

_AZIMUTH_DEG: Final = -60
_ELEVATION_DEG: Final = 25
_MAX_ZOOM: Final = 12


@dataclass(frozen=True)
class ScenePath:
    """A path of a scene: ``columns`` are those of x, y and z in mm."""

    name: str
    columns: tuple[str, str, str]
    tone: Tone
    marker: str
    size: float
    width: float
    dash: str = "solid"
    shown: bool = True


def scene(
    name: str, source: ColumnDataSource, box: Mapping[str, Range1d], paths: Sequence[ScenePath], whole: bool = True,
    height: int = 420,
) -> figure:  # fmt: skip
    """Return the figure of a scene, empty until the browser projects it; the first path is the one to follow.

    ``source`` has a name, the columns of the paths, and ``t`` in s, ascending; another figure must draw it too.
    ``box`` is the range in mm along ``x``, ``y`` and ``z``. With ``whole`` each whole path is drawn faint.
    """
    assert source.name is not None
    fig = figure(
        name=name, tags=[source.name], height=height, sizing_mode="stretch_width", tools="",
        toolbar_location=None, x_range=Range1d(start=-1, end=1), y_range=Range1d(start=-1, end=1), min_border=4,
    )  # fmt: skip
    fig.extra_x_ranges = dict(box)
    fig.axis.visible = False
    fig.grid.visible = False
    edges: dict[str, Any] = {"line_color": PALE.light, "line_width": 1}
    fig.segment("u0", "v0", "u1", "v1", source=_empty("u0", "v0", "u1", "v1"), **edges).tags = ["box"]
    names = fig.text(
        "u", "v", "text", source=_empty("u", "v", "text"), text_color=SOFT.light, text_font=value(FONT),
        text_font_size="12px", text_align="center", text_baseline="middle",
    )  # fmt: skip
    names.tags = ["names"]
    shadow = fig.line("u", "v", source=_empty(), line_color=AXIS.light, line_alpha=0.35)
    shadow.tags = _tags("shadow", paths[0])
    for path in paths if whole else ():
        _line(fig, "whole", path, path.width * 0.6, 0.35)
    for path in paths:
        _line(fig, "trail", path, path.width, 0.85)
    for path in paths:
        head = fig.scatter(
            "u", "v", source=_empty(), marker=path.marker, size=path.size, fill_color=path.tone.light,
            line_color=PAPER.light, fill_alpha=1.0 if path is paths[0] else 0.75,
        )  # fmt: skip
        head.tags = _tags("head", path)
        named(path.name, [head], path.shown)
    return fig


def camera_controls(name: str, end_s: float, at_s: float = 0.0) -> str:
    """Return the controls of the scene ``name`` as markup; its time goes from 0 to ``end_s``."""
    slider = _slider("Time", "time", (0.0, end_s, 0.01), at_s)
    return _controls(name, f'<button type="button" data-play>Play</button>{slider}<p data-errors></p>')


def live_camera_controls(name: str, shown_s: float) -> str:
    """Return the controls of a scene that shows now, or up to ``shown_s`` before the instant of its pause."""
    slider = _slider("Time", "time", (-shown_s, 0.0, 0.01), 0.0)
    return _controls(name, f'<button type="button" data-play>Pause</button>{slider}', " data-live")


def _controls(name: str, time: str, kind: str = "") -> str:
    return (
        f'<div class="camera" data-scene="{name}"{kind} role="group" aria-label="Camera and time of the figure">'
        + time
        + _slider("Turn", "azimuth", (-180, 180, 1), _AZIMUTH_DEG)
        + _slider("Tilt", "elevation", (-90, 90, 1), _ELEVATION_DEG)
        + _slider("Zoom", "zoom", (1, _MAX_ZOOM, 0.1), 1)
        + "</div>"
    )


def _slider(title: str, what: str, bounds: tuple[float, float, float], at: float) -> str:
    low, high, step = bounds
    return (
        f'<label class="{what}"><span>{title}</span><input type="range" data-camera="{what}" min="{low:g}" '
        f'max="{high:.6g}" step="{step:g}" value="{at:.6g}"><output></output></label>'
    )


def _line(fig: figure, part: str, path: ScenePath, width: float, alpha: float) -> None:
    line = fig.line(
        "u", "v", source=_empty(), line_color=path.tone.light, line_width=width, line_alpha=alpha,
        line_dash=path.dash, line_join="round",
    )  # fmt: skip
    line.tags = _tags(part, path)
    named(path.name, [line], path.shown)


def _tags(part: str, path: ScenePath) -> list[Any]:
    return [part, path.name, list(path.columns)]


def _empty(*names: str) -> ColumnDataSource:
    return ColumnDataSource({name: [] for name in names or ("u", "v")})
