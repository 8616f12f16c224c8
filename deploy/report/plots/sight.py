"""The surgeon's picture over time: the frames of each second by what became of them, and the age of each picture."""

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.palette import AMBER, BLUE, GREEN, OUTAGE, PINK, RED, SLATE
from tis.deploy.present.thinning import evenly_and_largest
from tis.deploy.report.run_view import MAX_TICKS, RunView
from tis.deploy.report.subjects.pictures import STATES, Pictures
from tis.deploy.report.subjects.sight_tables import sight_text

_TONES = dict(zip(STATES, (GREEN, AMBER, PINK, RED, SLATE), strict=True))
_MAX_BARS = 300
_MAX_FREEZES = 40


def sight_figure(run: RunView, x_range: Range1d) -> style.Figure | None:
    """Draw the strip of frames by the second, and below it the age of the pictures; None without sight."""
    found, summary = run.measured.pictures, run.summary.sight
    if found is None or summary is None:
        return None
    strip = style.time_figure(x_range, "frames, %", 190)
    strip.y_range = Range1d(start=0, end=100)
    seconds, shares = by_second(found)
    bottom = np.zeros(len(seconds))
    for state, share in shares.items():
        if share.any():
            source = style.data(
                left=seconds, right=seconds + _width_s(found), low=bottom, high=bottom + share, n=share
            )
            tone = _TONES[state].light
            bars = strip.quad("left", "right", "high", "low", source=source, fill_color=tone, line_color=None)
            style.hover(strip, bars, ("second", "@left{0}"), (state, "@n{0.0} %"))
        bottom = bottom + share
    ages = _ages(found, x_range)
    frozen = np.argsort(-found.freezes.lasted_ns)[:_MAX_FREEZES]
    for begin_ns, lasted_ns in zip(found.freezes.begin_ns[frozen], found.freezes.lasted_ns[frozen], strict=True):
        style.shade(ages, begin_ns / NS_PER_S, (begin_ns + lasted_ns) / NS_PER_S, OUTAGE.light)
    keys = [style.Key(state, _TONES[state], "bar") for state in STATES if summary.frames.get(state)]
    dated = "the time that the camera's program tells" if found.is_external else "the stamps in it"
    keys += [style.Key("glass to glass", BLUE, "dot")] + [style.Key("freeze", OUTAGE, "bar")] * bool(len(frozen))
    return style.Figure(
        plots=(strip, ages),
        title="What the surgeon saw",
        caption="Of the frames captured in each second, what the screen made of them; and how old each "
        f"picture was when it was shown, by {dated}. In a freeze the screen shows the same picture: "
        f"{number(summary.freezes)} here.",
        alt=f"Bars of frames by second, and the age of pictures over run time. Sight: {sight_text(summary)}.",
        keys=tuple(keys),
    )


def by_second(found: Pictures) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the seconds (S,), and in each the share of its frames in each state, in %; of long runs longer spans."""
    width = _width_s(found)
    span = (found.camera.captured_ns // (width * NS_PER_S)).astype(np.int64)
    n = np.bincount(span)
    seconds = np.flatnonzero(n)
    counted = {state: np.bincount(span[found.states == state], minlength=len(n))[seconds] for state in STATES}
    return seconds * float(width), {state: 100.0 * each / n[seconds] for state, each in counted.items()}


def _width_s(found: Pictures) -> int:
    return -(-int(found.camera.captured_ns[-1] // NS_PER_S + 1) // _MAX_BARS)


def _ages(found: Pictures, x_range: Range1d) -> figure:
    panel = style.time_figure(x_range, "age, ms", 190)
    shown_ns = found.shown_ns[found.dated]
    age_ms = (shown_ns - found.captured_ns) / NS_PER_MS
    kept = evenly_and_largest(age_ms, MAX_TICKS)
    panel.y_range = Range1d(start=0, end=1.1 * float(age_ms.max(initial=1.0)))
    source = style.data(t=shown_ns[kept] / NS_PER_S, age=age_ms[kept])
    dots = panel.scatter("t", "age", source=source, size=3, fill_color=BLUE.light, line_color=None)
    style.hover(panel, dots, ("run time", "@t{0.000} s"), ("glass to glass", "@age{0.0} ms"))
    return panel
