"""Identification figure for papers, and the style and file formats of all figures.

Imported on demand, as all modules that need matplotlib.
"""

from collections.abc import Sequence
from io import BytesIO
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from tis.patient_side.identification.identify import Identified, ValidationRun
from tis.patient_side.identification.order import OrderChoice
from tis.patient_side.identification.validation import fit_text
from tis.patient_side.statespace import ArmModel, order_text

FORMATS: Final = ("svg", "pdf", "png")
_MM: Final = 1000.0
_MIN_SPAN: Final = 1e3
_OUT_OF_FRAME_MM: Final = 1e6
_INK: Final = "#222222"
_SIMULATED: Final = "#d1495b"
STYLE: Final[dict[Any, Any]] = {
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.edgecolor": "none",
    "legend.framealpha": 0.9,
    "svg.hashsalt": "tis",  # the same figure is the same file
    "svg.fonttype": "none",
}


def identification_figure(found: Sequence[Identified]) -> Figure:
    """Return one row for each hand: singular values with the order of each selection rule, and the validation run.

    Oracle: the artists' data, test_figures.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.5, 3.7 * len(found)), layout="constrained")
        rows = figure.subfigures(len(found), 1, squeeze=False)[:, 0]
        for row, identified in zip(rows, found, strict=True):
            _draw(row, identified)
    return figure


def rendered(figure: Figure, file_format: str) -> bytes:
    """Return the figure as a file of one of `FORMATS`, the same bytes for the same figure."""
    buffer = BytesIO()
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(file_format)
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format=file_format, dpi=200, metadata=undated)
    return buffer.getvalue()


def _draw(row: SubFigure, identified: Identified) -> None:
    model, run = identified.model, identified.validation
    row.suptitle(
        f"{run.label}, {model.arm}: {model.method}, {model.block_rows} block rows, order {order_text(model)},"
        f" spectral radius {model.spectral_radius:.4f}",
        fontsize=9,
        color=_INK,
    )
    grid = row.add_gridspec(3, 2, width_ratios=(1, 1.5))
    _singular_values(row.add_subplot(grid[:, 0]), model, identified.orders)
    axes = [row.add_subplot(grid[axis, 1]) for axis in range(3)]
    _validation(axes, model, run)
    row.align_ylabels(axes)


def _singular_values(axes: Axes, model: ArmModel, orders: OrderChoice) -> None:
    values = np.asarray(model.singular_values)
    index = np.arange(1, len(values) + 1)
    shown = values > 0
    has_values = bool(np.any(shown))  # a regression has none
    curve = (index[shown], values[shown]) if has_values else (range(len(orders.predictions)), orders.predictions)
    axes.semilogy(*curve, "o-", color=_INK, markersize=3, linewidth=0.8)
    rules = (
        (orders.energy, "85 % energy", "#2e6f95", "-"),
        (orders.log_gap, "largest log-gap", "#d08c1d", "--"),
        (orders.criterion, "information criterion", "#8b5fbf", "-."),
        (orders.validation, "validation", "#3a8f5c", ":"),
    )
    for order, text, colour, dashes in rules:  # coinciding lines overlap, so each has its own dashes
        if order is None:
            continue
        axes.axvline(order, color=colour, linewidth=1.8, linestyle=dashes, label=f"{text}: {order}")
    if has_values:
        # at least three decades, so that flat singular values look flat
        low, high = float(values[shown].min()), float(values.max())
        widened = max(1.0, float(np.sqrt(_MIN_SPAN * low / high)))
        axes.set_ylim(low / widened / 1.5, high * widened * 1.5)
    counted, used = ("lags", model.n_lags) if model.n_lags is not None else ("order", model.order)
    chosen = [order for order, _, _, _ in rules if order is not None]
    axes.set_xlim(-0.8, max(len(values) or len(orders.predictions) - 1, used, *chosen) + 0.8)
    axes.set_xlabel(counted)
    if has_values:
        axes.set_ylabel("singular value")
        axes.set_title("Singular values and what each rule chooses", loc="left")
    else:
        axes.set_ylabel("error 5 samples ahead, over hold's")
        axes.set_title("Validation error and what each rule chooses", loc="left")
    axes.legend(  # below, where it hides nothing
        loc="upper center",
        bbox_to_anchor=(0.5, -0.14),
        ncols=2,
        title=f"{counted} used: {used}",
        alignment="left",
    )


def _validation(axes: Sequence[Axes], model: ArmModel, run: ValidationRun) -> None:
    t_s = (run.first_row + np.arange(len(run.truth_m))) / model.rate_hz
    for axis, (plot, name) in enumerate(zip(axes, "xyz", strict=True)):
        truth, simulated = _MM * run.truth_m[:, axis], _MM * run.simulated_m[:, axis]
        low, high = float(truth.min()), float(truth.max())
        # the truth sets the scale: a diverging simulation leaves the frame
        margin = 0.15 * max(high - low, 1e-3)
        plot.set_ylim(low - margin, high + margin)
        bounded = np.where(np.abs(simulated) < _OUT_OF_FRAME_MM, simulated, np.nan)
        plot.axvspan(t_s[0], t_s[min(run.n_start, len(t_s)) - 1], color="#e8e8e8", linewidth=0, label="initial state")
        plot.plot(t_s, truth, color=_INK, linewidth=1.4, label="truth")
        plot.plot(t_s, bounded, color=_SIMULATED, linewidth=0.9, linestyle=(0, (4, 2)), label="simulated")
        plot.set_xlim(t_s[0], t_s[-1])
        plot.set_ylabel(f"{name}, mm")
        away = ", off the scale" if model.fit_pct[axis] < -1000 else ""
        text = f"fit {fit_text(model.fit_pct[axis], 2)} %{away}"
        plot.text(1.0, 1.02, text, transform=plot.transAxes, ha="right", va="bottom")
        plot.tick_params(labelbottom=axis == 2)
    axes[0].set_title("Validation rows", loc="left")
    axes[2].set_xlabel("time of the trial, s")
    axes[2].legend(loc="upper center", bbox_to_anchor=(0.5, -0.5), ncols=3)  # below, where it hides nothing
