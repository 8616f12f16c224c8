"""Distributions: of delays and latencies, of runs of losses, and of netem's release error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from bokeh.models import Node
from bokeh.models.annotations import Label, Span
from bokeh.models.formatters import NumeralTickFormatter
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure
from numpy.typing import ArrayLike

from tis.common.channels import Direction
from tis.common.metrics.percentiles import median
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import counted, number
from tis.deploy.present.palette import AXIS, BLUE, DIRECTIONS, INK, PALE, PAPER, RED, VERMILION, Tone
from tis.deploy.present.thinning import distribution
from tis.deploy.report.subjects.network.key_figures import Array, LinkColumns
from tis.deploy.report.subjects.network.requested_pipeline import RequestedPipeline

_LEFT_OF: Final[dict[str, Any]] = {"x_offset": -4, "text_align": "right"}
_RIGHT_OF: Final[dict[str, Any]] = {"x_offset": 4, "text_align": "left"}
_SHARES = (0.001, *(i / 100 for i in range(1, 100)), 0.999)


@dataclass(frozen=True)
class Curve:
    """A distribution: values, or with ``percent`` points of its distribution function."""

    values: Sequence[float] | Array
    tone: Tone
    dash: str = "solid"
    percent: Sequence[float] | None = None
    width: float = 2


def distribution_figure(
    curves: Mapping[str, Curve], title: str, label: str, caption: str, limit_ms: float | None = None,
    told: str = "", unit: str = "ms",
) -> style.Figure | None:  # fmt: skip
    """Draw distributions; None without any. The medians of the curves whose names end in ``told`` end the caption."""
    if not curves:
        return None
    values = {name: np.asarray(curve.values) for name, curve in curves.items() if name.endswith(told)}
    medians = ", ".join(f"{name} {number(median(each))} {unit}" for name, each in values.items())
    limit = "" if limit_ms is None else " The dashed line is the limit for the p99 of the end-to-end latency."
    return style.Figure(
        plots=(cdf(curves, label, limit_ms, unit),),
        title=title,
        caption=f"{caption} Medians: {medians}.{limit}",
        alt=f"Cumulative distributions. Medians: {medians}.",
        keys=tuple(
            style.Key(n, c.tone, "dashed" if c.dash == "dashed" else "line", toggles=True) for n, c in curves.items()
        ),
    )


def delay_cdf(
    links: Mapping[Direction, LinkColumns], requests: Mapping[Direction, RequestedPipeline | None], varies: bool
) -> style.Figure | None:
    """Draw the delay of each direction: decided, realised, and requested if known; None when no message arrived.

    ``requests`` are shared by all keys of a direction, None where keys differ; ``varies``: they changed in the run.
    """
    curves: dict[str, Curve] = {}
    for direction, link in links.items():
        if not len(link.realised_ms):
            continue
        curves[f"{direction} decided"] = Curve(link.decided_ms, PALE, width=5)
        curves[f"{direction} realised"] = Curve(link.realised_ms, DIRECTIONS[direction])
        request = requests.get(direction)
        quantiles_ms = [] if request is None else [ms for ms in request.quantiles_ms(_SHARES) if ms is not None]
        if len(quantiles_ms) == len(_SHARES):
            named = f"{direction} requested" + (" (without changes)" if varies else "")
            curves[named] = Curve(quantiles_ms, INK, "dashed", [100 * share for share in _SHARES])
    if any("requested" in name for name in curves):
        same = "Where requested (dashed), decided (pale) and realised coincide, the network was the one requested"
    else:  # keys have networks of their own, or a stage has no distribution
        same = "All keys together, for which no single distribution was requested. Where decided (pale) and realised "
        same += "coincide, netem did as it decided"
    caption = (
        f"Follow the 99 % line to a curve: 99 of 100 messages took at most that long (p99). {same}; queues and "
        "waiting for earlier messages move realised to the right. Lost messages are not included."
    )
    return distribution_figure(
        curves, "How the delays are distributed", "delay in netem, ms", caption, told="realised"
    )


def latency_cdf(end_to_end_ms: ArrayLike, round_trip_ms: ArrayLike, limit_ms: float | None) -> style.Figure | None:
    """Draw the distributions of end-to-end latency and round trip; None when none is known."""
    both = {
        "end to end": Curve(np.asarray(end_to_end_ms, dtype=np.float64), BLUE),
        "round trip": Curve(np.asarray(round_trip_ms, dtype=np.float64), VERMILION),
    }
    caption = (
        "End to end is how old the newest sample is, command or arm position, when the estimate made with it is "
        "published; round trip is the surgeon's wait for the first answer to a command. The steps are the patient's "
        "ticks: a sample that comes just after a tick waits for the next one."
    )
    known = {name: curve for name, curve in both.items() if len(curve.values)}
    return distribution_figure(known, "How the latency is distributed", "latency, ms", caption, limit_ms)


def cdf(curves: Mapping[str, Curve], label: str, limit_ms: float | None, unit: str = "ms") -> figure:
    """Draw distributions as steps, with a line at 99 % and one at the limit, if any."""
    fig = style.plain_figure(
        320, x_axis_label=label, y_axis_label="share at or below, %", y_range=Range1d(start=0, end=104)
    )
    for name, curve in curves.items():
        value, percent = distribution(curve.values) if curve.percent is None else (curve.values, curve.percent)
        # starts at zero and steps up at each value, so that a constant shows as a step
        source = style.data(value=[value[0], *value], percent=[0.0, *percent])
        look: dict[str, Any] = {"line_dash": curve.dash, "line_width": curve.width}
        line = fig.step("value", "percent", source=source, mode="after", line_color=curve.tone.light, **look)
        style.named(name, [line])
        style.hover(fig, line, (name, "@percent{0.0} %"), ("at most", f"@value{{0.00}} {unit}"))
    fig.add_layout(Span(location=99, dimension="width", line_color=AXIS.light, line_dash="dotted"))
    at_left = False
    if limit_ms is not None:
        fig.add_layout(Span(location=limit_ms, dimension="height", line_color=RED.light, line_dash="dashed"))
        reach = max(float(np.max(curve.values)) for curve in curves.values())
        least = min(float(np.min(curve.values)) for curve in curves.values())
        room = 0.05 * (max(reach, limit_ms) - least)
        fig.x_range = Range1d(start=min(least, limit_ms) - room, end=max(reach, limit_ms) + room)
        # the label is at the bottom, on the side with more room
        at_left = limit_ms > (min(least, limit_ms) + max(reach, limit_ms)) / 2
        text = f"limit {limit_ms:g} ms"
        side = _LEFT_OF if at_left else _RIGHT_OF
        fig.add_layout(Label(x=limit_ms, y=6, text=text, text_color=RED.light, **side))
    # at the right end, where curves are flat, unless the limit is there
    at: dict[str, Any] = {"x": Node.frame.left, **_RIGHT_OF} if at_left else {"x": Node.frame.right, **_LEFT_OF}
    at |= {"background_fill_color": PAPER.light, "background_fill_alpha": 0.8}
    fig.add_layout(Label(y=99, y_offset=-4, text="p99", text_baseline="top", **at))
    return fig


_MAX_UNBINNED: Final = 40
_GROUND: Final = 0.5


def loss_figure(links: Mapping[Direction, LinkColumns]) -> style.Figure | None:
    """Draw the number of runs of each length, per direction, all keys together; None without losses."""
    used = {direction: link.run_lengths for direction, link in links.items() if len(link.run_lengths)}
    if not used:
        return None
    longest = max(int(lengths.max()) for lengths in used.values())
    width = max(1, -(-longest // _MAX_UNBINNED))
    # by direction: the shortest length of each bin that is not empty, and its number of runs
    bins = {d: np.unique((lengths - 1) // width, return_counts=True) for d, lengths in used.items()}
    counts = {direction: (place * width + 1, n) for direction, (place, n) in bins.items()}
    most = max(int(n.max()) for _, n in counts.values())
    fig = style.plain_figure(
        300,
        x_axis_label="messages lost one after the other",
        y_axis_label="runs",
        y_axis_type="log",  # keeps a single long burst visible beside hundreds of single losses
        y_range=Range1d(start=_GROUND, end=1.3 * most),
    )
    fig.yaxis.ticker = [base * 10**power for power in range(1 + len(str(most))) for base in (1, 2, 5)]
    fig.yaxis.formatter = NumeralTickFormatter(format="0")
    if longest <= 12:
        fig.xaxis.ticker = list(range(1, longest + 1))
    share = 0.8 * width / len(used)
    for i, (direction, (first, n)) in enumerate(counts.items()):
        left = first - 0.4 * width + i * share + 0.5 * (width - 1)
        length = [f"{low}" if width == 1 else f"{low} to {low + width - 1}" for low in first.tolist()]
        source = style.data(left=left, right=left + share, runs=n.astype(np.int32), length=length)
        colour = DIRECTIONS[direction].light
        bars = fig.quad("left", "right", _GROUND, "runs", source=source, fill_color=colour, line_color=None)
        style.hover(fig, bars, ("lost in a row", "@length"), ("runs", "@runs"))
    counts_of = ", ".join(f"{d} {counted(len(r), 'run')}, the longest of {r.max()}" for d, r in used.items())
    return style.Figure(
        plots=(fig,),
        title="How losses are bunched",
        caption="A bar counts the runs of consecutive lost messages of that length, key by key. Independent losses "
        f"are mostly single; bars far to the right are bursts and outages, which an estimator must bridge. Here "
        f"{counts_of}.",
        alt=f"Histogram of the lengths of loss runs: {counts_of}.",
        keys=tuple(style.Key(direction, DIRECTIONS[direction], "bar") for direction in used),
    )


_MIN_US = 1.0


def release_figure(links: Mapping[Direction, LinkColumns]) -> style.Figure | None:
    """Draw the share of packets above each release error; None in virtual time, which has no error."""
    errors = {direction: link.error_us for direction, link in links.items()}
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
        source = style.data(value=[_MIN_US, *value], above=[100.0, *above])
        colour = DIRECTIONS[direction].light
        line = fig.step("value", "above", source=source, mode="after", line_color=colour, line_width=2)
        style.hover(fig, line, ("later than", "@value{0} \u00b5s"), ("share", "@above %"))
    medians = ", ".join(f"{d}: median {median(e):.0f} \u00b5s" for d, e in used.items())
    return style.Figure(
        plots=(fig,),
        title="Release error",
        caption="The emulator decides an instant for each message and wakes up a little after it. Follow a curve to "
        "the right until it has fallen to 1 %: 99 of 100 messages left with at most that error (p99). A long tail "
        f"means that the machine was busy with something else. Here {medians}.",
        alt=f"Distribution of the release error on logarithmic axes. {medians}.",
        keys=tuple(style.Key(direction, DIRECTIONS[direction], "line") for direction in used),
    )
