"""Matplotlib figures of the comparison; imported on demand, as all modules that need matplotlib."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deploy.compare.results.plot_style import draw_line, tone
from deploy.methods.measures.plans import ALL
from deploy.report.publication.matplotlib_figures import STYLE

Figures = Mapping[str, Any]
Points = Sequence[tuple[float, Mapping[str, Any]]]
"""Places on the horizontal axis, each with a value's ratio and bounds."""

_MOST: Final = 2.0
"""Ratio to hold up to which is drawn: beyond it a method is useless."""


def accuracy_figure(methods: Sequence[Figures]) -> Figure:
    """Return the ratio to hold against the delay, with the intervals over people."""

    def points(figures: Figures) -> Points:
        return [(entry["delay_ms"], _ratio(entry)) for entry in figures["accuracy"]]

    with mpl.rc_context(STYLE):
        figure, (axes,) = _panels(1)
        _lines(axes, methods, points, "delay, ms", "3D RMSE over hold's")
        axes.set_xscale("log")
        axes.set_ylim(0, min(_MOST, axes.get_ylim()[1]))
        _legend(figure, axes)
    return figure


def disturbance_figure(methods: Sequence[Figures]) -> Figure:
    """Return the error over the undisturbed one against loss, loss in bursts, and noise."""

    def of_loss(bursts: bool) -> Callable[[Figures], Points]:
        return lambda figures: [
            (entry["loss_pct"], entry["growth"])
            for entry in figures["loss"]
            if entry["growth"] and entry["bursts"] == bursts
        ]

    def of_noise(figures: Figures) -> Points:
        return [(entry["noise_mm"], entry["growth"]) for entry in figures["noise"] if entry["growth"]]

    with mpl.rc_context(STYLE):
        figure, (independent, bursts, noise) = _panels(3)
        _lines(independent, methods, of_loss(False), "loss, %, independent", "error over that without")
        _lines(bursts, methods, of_loss(True), "loss, %, in bursts", "")
        _lines(noise, methods, of_noise, "sensor noise, mm", "")
        _legend(figure, independent)
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
            axes.set_xscale("log")
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
        axes.set_xscale("log")
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


def _legend(figure: Figure, axes: Axes) -> None:
    handles, names = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, names, loc="outside lower center", ncols=4)


def _ratio(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    return {"ratio": entry["ratio_to_hold"], "low": entry["low"], "high": entry["high"]}
