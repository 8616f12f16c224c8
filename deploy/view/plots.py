"""Figures of the live page: bounded sources that grow at one end, in the report's colours."""

from collections.abc import Mapping
from typing import Any, Final

from bokeh.models import BasicTicker, ColumnDataSource, Range1d
from bokeh.plotting import figure

from tis.deploy.present.palette import BLUE, DIRECTIONS, INK, PAPER, RED, VIOLET, Tone, look_of
from tis.deploy.report.plots.scene_3d import ScenePath, scene
from tis.deploy.view.feed import FELT_COLUMNS, MASTER_COLUMNS, SHOWN_S, TRACK_COLUMNS, Columns, Frame
from tis.deploy.watch.streams import StreamName

TRUTH: Final = INK
ESTIMATE: Final = BLUE
HOLD: Final = look_of("hold").tone
LOST: Final = RED
SCENE: Final = "path"
STREAM_TONES: Final[Mapping[StreamName, Tone]] = {
    "master": VIOLET,
    "arm": DIRECTIONS["forward"],
    "answers": DIRECTIONS["feedback"],
}
_DASHES: Final[Mapping[StreamName, str]] = {"master": "dashed", "arm": "solid", "answers": "dotted"}
_MARKERS: Final[Mapping[StreamName, str]] = {"master": "triangle", "arm": "circle", "answers": "square"}
_LINES: Final = (("t", TRUTH, 3.0), ("h", HOLD, 1.5), ("e", ESTIMATE, 2.0))
_NAMES: Final = ("truth", "hold", "estimate")
_MARGIN: Final = 0.05
_MIN_FILL: Final = 0.4
_BELOW_ZERO: Final = 0.06  # keeps marks at 0 entirely visible
_MAX_ROWS: Final = 720
_MAX_TRAIL_ROWS: Final = 90
_HEAD_MARKERS: Final = {"t": ("circle", 13, TRUTH), "h": ("square", 10, HOLD), "e": ("diamond", 14, ESTIMATE)}


class Window:
    """Axis range that follows the data in steps, so that a figure does not rescale at each frame."""

    def __init__(self, min_width: float, from_zero: bool = False) -> None:
        self.range: Final = Range1d(start=0, end=min_width)
        self.begin, self.end = 0.0, min_width
        self._min_width = min_width
        self._from_zero = from_zero

    def fit(self, low: float, high: float) -> None:
        """Show ``low`` to ``high``; the range stays while they fit and fill enough of it."""
        if not self.fits(low, high, high - low):
            self.show(low, high, high - low)

    def fits(self, low: float, high: float, span: float) -> bool:
        """Tell whether ``low`` to ``high`` lie within the range, and ``span`` fills it well."""
        width = self.end - self.begin
        margin = _MARGIN * width  # keeps marks at the edge entirely visible
        inside = (self._from_zero or self.begin + margin <= low) and high <= self.end - margin
        return inside and _MIN_FILL * width < max(span, self._min_width) <= width

    def show(self, low: float, high: float, span: float) -> None:
        """Set a range for ``span`` centred on ``low`` to ``high``, or one that begins at 0."""
        if self._from_zero:
            self.end = 1.3 * max(high, self._min_width)
            self.begin = -_BELOW_ZERO * self.end
        else:
            middle, half = (low + high) / 2, 0.65 * max(span, self._min_width)
            self.begin, self.end = middle - half, middle + half
        self.range.update(start=self.begin, end=self.end)


class Plots:
    """All figures of one page and their data sources."""

    def __init__(self) -> None:
        self.time: Final = Range1d(start=0, end=SHOWN_S)
        self.track: Final = _source(TRACK_COLUMNS)
        self.master: Final = _source(MASTER_COLUMNS)
        self.trail: Final = _source(TRACK_COLUMNS)
        self.master_trail: Final = _source(MASTER_COLUMNS)
        self.head: Final = _source(TRACK_COLUMNS)
        self.master_head: Final = _source(MASTER_COLUMNS)
        self.age: Final = _source(("t", "age"))
        self.felt: Final = _source(FELT_COLUMNS)
        self.delays: Final = {name: _source(("t", "delay", "lost")) for name in STREAM_TONES}
        self.losses: Final = {name: _source(("t", "loss")) for name in STREAM_TONES}
        self.windows: Final[dict[str, Window]] = {}
        self.plane_xy: Final = self._plane()
        self.master_plane: Final = self._master_plane()
        self.positions: Final = {f"position_{axis}": self._position(axis) for axis in "xyz"}
        self.path: Final = self._path()
        self.network: Final = {
            "delay": self._delay(),
            "loss": self._loss(),
            "age": self._age(),
            "error": self._error(),
            "turn": self._turn(),
            "force": self._force(),
            "energy": self._energy(),
        }

    def roots(self) -> dict[str, figure]:
        """Return every figure by the name that the page's template uses."""
        planes = {"plane_xy": self.plane_xy, "plane_master": self.master_plane}
        return {SCENE: self.path, **planes, **self.positions, **self.network}

    def show(self, frame: Frame) -> None:
        """Draw a frame's rows and move the time axis."""
        if frame.starts_over:
            for source in (
                self.track,
                self.trail,
                self.head,
                self.master,
                self.master_trail,
                self.master_head,
                self.age,
                self.felt,
            ):
                source.data = {name: [] for name in source.data}
        _stream(self.track, frame.track)
        _stream(self.trail, frame.track, _MAX_TRAIL_ROWS)
        _stream(self.head, frame.track, 1)
        _stream(self.master, frame.master_track)
        _stream(self.master_trail, frame.master_track, _MAX_TRAIL_ROWS)
        _stream(self.master_head, frame.master_track, 1)
        _stream(self.age, frame.age)
        _stream(self.felt, frame.felt)
        for name, columns in frame.delays.items():
            _stream(self.delays[name], columns)
        for name, columns in frame.losses.items():
            _stream(self.losses[name], columns)
        begin_s = max(0.0, frame.now_s - SHOWN_S)
        self.time.update(start=begin_s, end=begin_s + SHOWN_S)
        self._fit(begin_s)

    def _fit(self, begin_s: float) -> None:
        def extent(source: ColumnDataSource, *columns: str) -> tuple[float, float] | None:
            times = source.data["t"]
            values = [
                v
                for name in columns
                for t, v in zip(times, source.data[name], strict=True)
                if t >= begin_s and v == v
            ]
            return (min(values), max(values)) if values else None

        places = {axis: extent(self.track, f"t{axis}", f"e{axis}", f"h{axis}") for axis in "xyz"}
        masters = {axis: extent(self.master, f"m{axis}") for axis in "xyz"}
        for axis, found in places.items():
            if found is not None:
                self.windows[axis].fit(*found)
        for key, where in (("xy", places), ("master", masters)):
            one, two = where["x"], where["y"]
            if one is not None and two is not None:  # equal scales: both axes are as wide as the wider one
                span = max(one[1] - one[0], two[1] - two[0])
                pair = ((self.windows[f"{key} x"], one), (self.windows[f"{key} y"], two))
                if not all(window.fits(*found, span) for window, found in pair):
                    for window, found in pair:
                        window.show(*found, span)
        self._fit_energy(extent(self.felt, "put_in"))
        # axes that begin at 0 follow the largest value of all their sources
        growing = [
            ("delay", [found for source in self.delays.values() if (found := extent(source, "delay"))]),
            ("age", [found for found in [extent(self.age, "age")] if found]),
            ("error", [found for found in [extent(self.track, "error", "hold_error")] if found]),
            ("force", [found for found in [extent(self.felt, "hand", "tool")] if found]),
            ("turn", [found for found in [extent(self.track, "turn", "hold_turn")] if found]),
            ("loss", [found for source in self.losses.values() if (found := extent(source, "loss"))]),
        ]
        for key, extents in growing:
            if extents:
                self.windows[key].fit(0, max(high for _, high in extents))

    def _fit_energy(self, put_in: tuple[float, float] | None) -> None:
        if put_in is not None:
            self.windows["energy"].fit(min(put_in[0], 0.0), max(put_in[1], 0.0))

    def _window(self, key: str, min_width: float, from_zero: bool = False) -> Range1d:
        self.windows[key] = Window(min_width, from_zero)
        return self.windows[key].range

    def _path(self) -> figure:
        """Return the arm's last seconds in space, in a box that follows the data as the axes over time do."""
        self.track.name = "path-track"
        paths = [
            ScenePath(name, (f"{kind}x", f"{kind}y", f"{kind}z"), tone, *_HEAD_MARKERS[kind][:2], width)
            for name, (kind, tone, width) in zip(_NAMES, _LINES, strict=True)
        ]
        box = {axis: self.windows[axis].range for axis in "xyz"}
        return scene(SCENE, self.track, box, paths, whole=False)

    def _plane(self) -> figure:
        fig = _square(self._window("xy x", 2), self._window("xy y", 2))
        for kind, tone, width in _LINES:
            fig.line(f"{kind}x", f"{kind}y", source=self.trail, line_color=tone.light, line_width=width, alpha=0.55)
        for kind, (marker, size, tone) in _HEAD_MARKERS.items():
            fig.scatter(
                f"{kind}x", f"{kind}y", source=self.head, marker=marker, size=size, fill_color=tone.light,
                line_color=PAPER.light, line_width=1,
            )  # fmt: skip
        return fig

    def _master_plane(self) -> figure:
        fig = _square(self._window("master x", 2), self._window("master y", 2))
        tone = STREAM_TONES["master"].light
        fig.line("mx", "my", source=self.master_trail, line_color=tone, line_width=2, alpha=0.6)
        fig.scatter(
            "mx", "my", source=self.master_head, marker="triangle", size=13, fill_color=tone, line_color=PAPER.light
        )
        return fig

    def _position(self, axis: str) -> figure:
        fig = self._over_time(f"{axis}, mm", self._window(axis, 2), with_axis=axis == "z")
        for kind, tone, width in _LINES:
            fig.line("t", f"{kind}{axis}", source=self.track, line_color=tone.light, line_width=width)
        return fig

    def _error(self) -> figure:
        fig = self._over_time("error, mm", self._window("error", 0.5, from_zero=True))
        fig.line("t", "hold_error", source=self.track, line_color=HOLD.light, line_width=1.5)
        fig.line("t", "error", source=self.track, line_color=ESTIMATE.light, line_width=2)
        return fig

    def _turn(self) -> figure:
        fig = self._over_time("error, \u00b0", self._window("turn", 2, from_zero=True))
        fig.line("t", "hold_turn", source=self.track, line_color=HOLD.light, line_width=1.5)
        fig.line("t", "turn", source=self.track, line_color=ESTIMATE.light, line_width=2)
        return fig

    def _delay(self) -> figure:
        fig = self._over_time("one-way delay, ms", self._window("delay", 5, from_zero=True))
        for name, source in self.delays.items():
            tone = STREAM_TONES[name].light
            fig.scatter(
                "t", "delay", source=source, marker=_MARKERS[name], size=5, fill_alpha=0.35, line_alpha=0.9,
                fill_color=tone, line_color=tone,
            )  # fmt: skip
        for source in self.delays.values():
            fig.scatter("t", "lost", source=source, marker="x", size=8, line_color=LOST.light, line_width=2)
        return fig

    def _loss(self) -> figure:
        fig = self._over_time("lost, %", self._window("loss", 4, from_zero=True))
        for name, source in self.losses.items():
            look: dict[str, Any] = {"line_color": STREAM_TONES[name].light, "line_dash": _DASHES[name]}
            fig.step("t", "loss", source=source, mode="center", line_width=2, **look)
        return fig

    def _age(self) -> figure:
        fig = self._over_time("age, ms", self._window("age", 10, from_zero=True))
        fig.line("t", "age", source=self.age, line_color=INK.light, line_width=2)
        return fig

    def _force(self) -> figure:
        fig = self._over_time("force, N", self._window("force", 0.5, from_zero=True))
        fig.line("t", "tool", source=self.felt, line_color=TRUTH.light, line_width=3)
        fig.line("t", "hand", source=self.felt, line_color=STREAM_TONES["master"].light, line_width=2)
        return fig

    def _energy(self) -> figure:
        fig = self._over_time("energy, mJ", self._window("energy", 1))
        fig.hspan(y=0, line_color=TRUTH.light, line_width=1)
        fig.varea("t", "put_in", 0, source=self.felt, fill_color=STREAM_TONES["master"].light, fill_alpha=0.3)
        fig.line("t", "put_in", source=self.felt, line_color=STREAM_TONES["master"].light, line_width=2)
        return fig

    def _over_time(self, y_label: str, y_range: Range1d, with_axis: bool = True) -> figure:
        fig = figure(
            height=170 if with_axis else 128, sizing_mode="stretch_width", x_range=self.time, y_range=y_range,
            y_axis_label=y_label, tools="", toolbar_location=None,
            min_border_left=66, min_border_right=14, min_border_top=8,
        )  # fmt: skip
        if with_axis:
            fig.xaxis.axis_label = "run time, s"
        else:
            fig.xaxis.major_label_text_font_size = "0px"
        fig.yaxis.ticker = BasicTicker(desired_num_ticks=4)
        return fig


def _square(x_range: Range1d, y_range: Range1d) -> figure:
    """Return a figure whose two axes have one scale: as wide as high, and with equal borders."""
    fig = figure(
        aspect_ratio=1, sizing_mode="scale_width", x_range=x_range, y_range=y_range, tools="", toolbar_location=None,
        min_border_left=64, min_border_right=12, min_border_bottom=56, min_border_top=20,
        x_axis_label="x, mm", y_axis_label="y, mm",
    )  # fmt: skip
    fig.xaxis.ticker = BasicTicker(desired_num_ticks=3)  # few enough for labels on one line
    fig.yaxis.ticker = BasicTicker(desired_num_ticks=4)
    return fig


def _source(names: tuple[str, ...]) -> ColumnDataSource:
    return ColumnDataSource({name: [] for name in names})


def _stream(source: ColumnDataSource, columns: Columns, most: int = _MAX_ROWS) -> None:
    if columns["t"]:
        source.stream({name: values[-most:] for name, values in columns.items()}, rollover=most)
