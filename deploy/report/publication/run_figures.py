"""A run's figures for papers, in column width with legible type.

Imported on demand, as it needs matplotlib.
"""

from collections.abc import Mapping
from typing import Any, Final, get_args

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tis.common.channels import Direction
from tis.common.units import MM_PER_M, NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.palette import BLUE, DIRECTIONS, RED, VERMILION, look_of
from tis.deploy.present.thinning import distribution, evenly_and_largest, worst
from tis.deploy.report.publication.matplotlib_figures import STYLE
from tis.deploy.report.run_view import HandView, RunView
from tis.deploy.report.subjects.network.key_figures import LinkColumns, link_columns
from tis.deploy.report.subjects.tracking import error_by_age

COLUMN_IN: Final = 3.5
"""Width of a column of a two-column paper: 89 mm, IEEE's 3.5 in."""

_MAX_POINTS: Final = 2000
_DASHES: Final = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}


def paper_figures(run: RunView) -> dict[str, Figure]:
    """Return the figures that a run's logs allow, by file name; oracle: the artists' data, test_run_figures."""
    found: dict[str, Figure | None] = {}
    with mpl.rc_context(STYLE):
        views = run.hands
        for hand, view in views.items():
            suffix = f"_{hand}" if len(views) > 1 else ""
            found[f"position{suffix}"] = _position(view)
            found[f"error{suffix}"] = _error(view)
            found[f"error_by_age{suffix}"] = _error_by_age(view)
        latency_ms, trips_ms = (
            ns / NS_PER_MS for ns in (run.measured.latency.end_to_end, run.measured.round_trips_ns)
        )
        both = {"end to end": (latency_ms, BLUE.light), "round trip": (trips_ms, VERMILION.light)}
        found["latency_cdf"] = _cdf(both, "latency, ms")
    return _drawn(found) | network_figures(run.logs)


def network_figures(logs: RunLogs) -> dict[str, Figure]:
    """Return the figures of the network, by file name."""
    links: dict[Direction, LinkColumns] = {d: link_columns(logs, d) for d in get_args(Direction)}
    found: dict[str, Figure | None] = {}
    with mpl.rc_context(STYLE):
        found["delay"] = _delay(links)
        delays_ms = {d: (link.realised_ms, DIRECTIONS[d].light) for d, link in links.items()}
        found["delay_cdf"] = _cdf(delays_ms, "delay in netem, ms")
        found["loss_runs"] = _loss(links)
    return _drawn(found)


def _drawn(found: Mapping[str, Figure | None]) -> dict[str, Figure]:
    return {name: figure for name, figure in found.items() if figure is not None}


def _blank(height_in: float, x_label: str, *y_labels: str) -> tuple[Figure, list[Axes]]:
    """Return a figure with a panel for each label of a vertical axis."""
    figure = Figure(figsize=(COLUMN_IN, height_in), layout="constrained")
    rows = list(figure.subplots(len(y_labels), 1, sharex=True, squeeze=False)[:, 0])
    for axes, label in zip(rows, y_labels, strict=True):
        axes.set_ylabel(label)
    rows[-1].set_xlabel(x_label)
    return figure, rows


def _shown(view: HandView) -> list[str]:
    """Return the estimators that are drawn: hold and the active one."""
    return [name for name in ("hold", view.active) if name in view.errors_mm]


def _line(axes: Axes, name: str, x: np.ndarray, y: np.ndarray, width: float = 0.9) -> None:
    look = look_of(name)
    axes.plot(x, y, color=look.tone.light, linewidth=width, linestyle=_DASHES[look.dash], label=name)


def _position(view: HandView) -> Figure | None:
    if not np.isfinite(view.track.truth_m).any():
        return None
    figure, rows = _blank(3.3, "run time, s", "x, mm", "y, mm", "z, mm")
    largest_mm = np.fmax.reduce([view.errors_mm[name] for name in _shown(view)]) if _shown(view) else None
    kept = np.arange(view.n_ticks) if largest_mm is None else worst(largest_mm, _MAX_POINTS)
    t_s = view.track.t_ns[kept] / NS_PER_S
    for i, axes in enumerate(rows):
        _line(axes, "truth", t_s, MM_PER_M * view.track.truth_m[kept, i], 1.8)
        for name in _shown(view):
            _line(axes, name, t_s, MM_PER_M * view.track.estimates[name][kept, i])
    figure.align_ylabels(rows)
    _legend(figure, rows[0])
    return figure


def _error(view: HandView) -> Figure | None:
    names = [name for name in _shown(view) if np.isfinite(view.errors_mm[name]).any()]
    if not names:
        return None
    figure, (axes,) = _blank(1.9, "run time, s", "error in 3D, mm")
    for name in names:
        kept = worst(view.errors_mm[name], _MAX_POINTS)
        _line(axes, name, view.track.t_ns[kept] / NS_PER_S, view.errors_mm[name][kept], 0.7)
    axes.set_ylim(bottom=0)
    _legend(figure, axes)
    return figure


def _error_by_age(view: HandView) -> Figure | None:
    scored = view.track.scored
    curves = {name: error_by_age(view.age_ms[scored], view.errors_mm[name][scored]) for name in _shown(view)}
    curves = {name: curve for name, curve in curves.items() if len(curve.n)}
    if not curves:
        return None
    figure, (axes,) = _blank(1.9, "age of the newest sample at the tick, ms", "RMSE in 3D, mm")
    for name, curve in curves.items():
        look = look_of(name)
        dashes = _DASHES[look.dash]
        axes.plot(curve.age_ms, curve.rmse, dashes, marker="o", markersize=3, color=look.tone.light, label=name)
    axes.set_ylim(bottom=0)
    _legend(figure, axes)
    return figure


def _cdf(curves: Mapping[Any, tuple[np.ndarray, str]], label: str) -> Figure | None:
    used = {name: (values, colour) for name, (values, colour) in curves.items() if len(values)}
    if not used:
        return None
    figure, (axes,) = _blank(1.9, label, "share at or below, %")
    for name, (values, colour) in used.items():
        value, percent = distribution(values)
        axes.step([value[0], *value], [0.0, *percent], where="post", color=colour, linewidth=1.1, label=name)
    axes.axhline(99, color="#8a949e", linewidth=0.6, linestyle=":")
    axes.set_ylim(0, 102)
    _legend(figure, axes)
    return figure


def _delay(links: Mapping[Direction, LinkColumns]) -> Figure | None:
    used = {d: link for d, link in links.items() if len(link.realised_ms)}
    if not used:
        return None
    figure, rows = _blank(1.2 + 0.9 * len(used), "run time, s", *(f"{direction}, ms" for direction in used))
    for axes, (direction, link) in zip(rows, used.items(), strict=True):
        kept = evenly_and_largest(link.realised_ms, _MAX_POINTS)
        sent_s, realised_ms = link.sent_s[kept], link.realised_ms[kept]
        axes.plot(sent_s, realised_ms, ".", markersize=1.5, color=DIRECTIONS[direction].light, label=direction)
        lost_s = link.lost_s
        axes.plot(
            lost_s, np.zeros(len(lost_s)), "|", markersize=3, color=RED.light, markeredgewidth=0.3, label="lost"
        )
    return figure


def _loss(links: Mapping[Direction, LinkColumns]) -> Figure | None:
    used = {direction: link.run_lengths for direction, link in links.items() if len(link.run_lengths)}
    if not used:
        return None
    figure, (axes,) = _blank(1.9, "messages lost one after the other", "runs")
    for i, (direction, values) in enumerate(used.items()):
        length, n = np.unique(values, return_counts=True)
        width = 0.8 / len(used)
        axes.bar(length - 0.4 + (i + 0.5) * width, n, width, color=DIRECTIONS[direction].light, label=direction)
    axes.set_yscale("log")
    _legend(figure, axes)
    return figure


def _legend(figure: Figure, axes: Axes) -> None:
    """Put the legend above the frame, clear of the curves."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=max(1, min(len(labels), 4)))
