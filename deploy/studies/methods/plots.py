"""Matplotlib figures of the comparison; imported on demand, as all modules that need matplotlib."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from tis.deploy.compare.results.figures import draw_line, tone
from tis.deploy.report.publication.matplotlib_figures import STYLE
from tis.deploy.studies.methods.plans import ALL

Figures = Mapping[str, Any]
Points = Sequence[tuple[float, Mapping[str, Any]]]
"""Places on the horizontal axis, each with a value's ratio and bounds."""

_LEGEND_COLUMNS: Final = {1: 3, 2: 4, 4: 6}
"""By number of panels: what fits their width."""
_MOST: Final = 2.0
"""Ratio to hold up to which is drawn: beyond it a method is useless."""


def accuracy_figure(methods: Sequence[Figures]) -> Figure:
    """Return the ratio to hold against the delay, with the intervals over people."""

    def points(figures: Figures) -> Points:
        return [(entry["delay_ms"], _ratio(entry)) for entry in figures["accuracy"]]

    with mpl.rc_context(STYLE):
        figure, (axes,) = _panels(1)
        _lines(axes, methods, points, "delay, ms", "3D RMSE over hold's")
        _log_across(axes)
        _bound(axes)
        _legend(figure, axes)
    return figure


def disturbance_figure(methods: Sequence[Figures]) -> Figure:
    """Return the ratio to hold against loss, loss in bursts, noise, and noise that the training had as well."""

    def of_loss(bursts: bool) -> Callable[[Figures], Points]:
        return lambda figures: [
            (entry["loss_pct"], _ratio(entry)) for entry in figures["loss"] if entry["bursts"] == bursts
        ]

    def of_noise(measure: str) -> Callable[[Figures], Points]:
        return lambda figures: [(entry["noise_mm"], _ratio(entry)) for entry in figures[measure]]

    panels = {
        "loss, %, independent": of_loss(False),
        "loss, %, in bursts": of_loss(True),
        "noise, mm": of_noise("noise"),
        "noise, mm, trained with it": of_noise("noise_trained"),
    }
    with mpl.rc_context(STYLE):
        figure, each = _panels(len(panels))
        for axes, (across, points) in zip(each, panels.items(), strict=True):
            _lines(axes, methods, points, across, "3D RMSE over hold's" if axes is each[0] else "")
            _bound(axes)
        _legend(figure, each[0])
    return figure


def training_figure(methods: Sequence[Figures]) -> Figure:
    """Return error and time of training against the number of training rows."""

    def errors(figures: Figures) -> Points:
        return [(entry["n_rows"], _ratio(entry)) for entry in figures["data"] if entry["n_rows"]]

    def times(figures: Figures) -> Points:
        return [
            (entry["n_rows"], {"ratio": entry["train_s"], "low": None, "high": None})
            for entry in figures["data"]
            if entry["n_rows"]
        ]

    with mpl.rc_context(STYLE):
        figure, (error, time) = _panels(2)
        _lines(error, methods, errors, "training rows", "3D RMSE over hold's")
        _lines(time, methods, times, "training rows", "training, s")
        for axes in (error, time):
            _log_across(axes)
        _bound(error)
        time.set_yscale("log")
        _legend(figure, error)
    return figure


def steps_figure(methods: Sequence[Figures]) -> Figure:
    """Return the time of a step, median and p99, beside the error: what each method buys with its time."""
    names = [str(figures["method"]) for figures in methods]
    with mpl.rc_context(STYLE):
        figure, (axes,) = _panels(1)
        for figures in methods:
            step, data = figures["step"], [entry for entry in figures["data"] if entry["n_trials"] == ALL]
            if step is None or not data:
                continue
            name, ratio = str(figures["method"]), data[0]["ratio_to_hold"]
            draw_line(axes, name, names, [step["p50_us"]], [ratio])
            axes.plot([step["p50_us"], step["p99_us"]], [ratio, ratio], color=tone(name, names), linewidth=0.8)
        _log_across(axes)
        _bound(axes)
        axes.set_xlabel("time of a step, µs: median and p99")
        axes.set_ylabel("3D RMSE over hold's")
        _legend(figure, axes)
    return figure


FIGURES: Final[Mapping[str, Callable[[Sequence[Figures]], Figure]]] = {
    "accuracy": accuracy_figure,
    "disturbances": disturbance_figure,
    "training": training_figure,
    "steps": steps_figure,
}


def _panels(n: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(1.2 + 3.0 * n, 3.6), layout="constrained")
    return figure, list(figure.subplots(1, n, squeeze=False)[0])


def _lines(axes: Axes, methods: Sequence[Figures], points: Callable[[Figures], Points], across: str, up: str) -> None:
    """Draw a line for each method that has points, with a bar for each interval."""
    names = [str(figures["method"]) for figures in methods]
    for figures in methods:
        name, found = str(figures["method"]), sorted(points(figures), key=lambda point: point[0])
        if not found:
            continue
        draw_line(axes, name, names, [x for x, _ in found], [value["ratio"] for _, value in found])
        for x, value in found:
            if value["low"] is not None:
                axes.plot([x, x], [value["low"], value["high"]], color=tone(name, names), linewidth=0.8, alpha=0.6)
    axes.set_xlabel(across)
    axes.set_ylabel(up)


def _log_across(axes: Axes) -> None:
    """Make the horizontal axis logarithmic, with numbers that are read at a glance, also within a decade."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _bound(axes: Axes) -> None:
    """Show ratios up to `_MOST`, and name the methods that are beyond it everywhere."""
    ratios = {
        str(line.get_label()): np.asarray(line.get_ydata(), dtype=float)
        for line in axes.lines
        if not str(line.get_label()).startswith("_")
    }
    beyond = [name for name, ratio in ratios.items() if ratio.min() > _MOST]
    shown = [float(ratio.max()) for name, ratio in ratios.items() if name not in beyond]
    axes.set_ylim(0, min(_MOST, 1.15 * max(shown, default=_MOST)))
    if beyond:
        axes.set_title(f"above {_MOST:g}: {', '.join(beyond)}", loc="left")


def _legend(figure: Figure, axes: Axes) -> None:
    handles, names = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, names, loc="outside lower center", ncols=_LEGEND_COLUMNS[len(figure.axes)])


def _ratio(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    return {"ratio": entry["ratio_to_hold"], "low": entry["low"], "high": entry["high"]}
