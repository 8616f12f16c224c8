"""Plots of the paper, drawn again: x, y, z over time with the estimate beside the arm, and singular values.

Imported on demand, as all modules that need matplotlib.
"""

from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tis.common.runtime.recordings import load_recording
from tis.deploy.present.palette import TRUTH, look_of
from tis.deploy.report.publication.matplotlib_figures import STYLE
from tis.deploy.studies.paper.cells import (
    ORDER,
    PAIRINGS,
    ROWS,
    TRAIN_SAMPLES,
    Pairing,
    Results,
    run_algorithm,
    scenario_of,
)
from tis.deploy.studies.paper.page import nearest_simulation
from tis.patient_side.linear_system import Array

_TITLES: Final[dict[Pairing, str]] = {"same_name": "same-name pair", "cross": "true pair"}
_ENERGY: Final = 0.85
"""Share of the sum of singular values by which the paper chooses its order."""


def drawn(results: Results) -> list[Figure]:
    """Return the positions on the same-name pair and on the true pair, and the singular values of both."""
    return [*(positions_figure(results, pairing) for pairing in PAIRINGS), singular_values_figure(results)]


def positions_figure(results: Results, pairing: Pairing) -> Figure:
    """Return x, y, z of the arm and of Algorithm 1 over a whole trial, in units of the training rows' range.

    The network is that of the run which is nearest to the figures of the paper's text.
    """
    _, number, reading, _ = nearest_simulation(results)
    model, trial = results.models[pairing, "moesp_paper"], results.trial
    recording = load_recording(scenario_of(trial, pairing))
    hand = recording.hands[0]
    row = next(row for row in ROWS if row.number == number)
    found = run_algorithm(row, reading, model, hand, recording.rate_hz, trial.seed, False)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.5, 5.4), layout="constrained")
        each = figure.subplots(3, 1, sharex=True)
        tracks_m = (hand.follower.position_m, found.estimate_m)
        span_m = model.output_high_m - model.output_low_m
        for axis, (axes, name) in enumerate(zip(each, "xyz", strict=True)):
            arm, estimate = ((m[:, axis] - model.output_low_m[axis]) / span_m[axis] for m in tracks_m)
            _draw_axis(axes, name, arm, estimate, recording.rate_hz)
        each[-1].set_xlabel("time, s")
        each[0].legend(loc="upper right", ncols=2)
        of = f"{hand.arm} of {recording.label}, {_TITLES[pairing]}, network of row {number} read as {reading}"
        figure.suptitle(f"{of}\nPositions in units of the range of the training rows, which end at the dotted line")
    return figure


def singular_values_figure(results: Results) -> Figure:
    """Return the singular values of the paper's identification on both pairs, with its order and that of 85 %."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.5, 3.0), layout="constrained")
        for axes, pairing in zip(figure.subplots(1, 2, sharey=True), PAIRINGS, strict=True):
            values = np.asarray(results.models[pairing, "moesp_paper"].singular_values)
            axes.semilogy(np.arange(1, len(values) + 1), values, "o-", color=TRUTH.tone.light, markersize=3)
            axes.axvline(ORDER, color=look_of("paper").tone.light, label=f"the paper's order: {ORDER}")
            energy = energy_order(values)
            axes.axvline(energy, color=look_of("hold").tone.light, linestyle="--", label=f"85 % of the sum: {energy}")
            axes.set_title(_TITLES[pairing], loc="left")
            axes.set_xlabel("mode")
            axes.legend()
        figure.axes[0].set_ylabel("singular value")
    return figure


def energy_order(values: Array) -> int:
    """Return the smallest number of singular values (n,) whose sum is at least 85 % of that of all."""
    shares = np.cumsum(values) / np.sum(values)
    return int(np.searchsorted(shares, _ENERGY) + 1)


def _draw_axis(axes: Axes, name: str, arm: Array, estimate: Array, rate_hz: int) -> None:
    t_s = np.arange(len(arm)) / rate_hz
    axes.plot(t_s, arm, color=TRUTH.tone.light, linewidth=1.0, label="arm")
    axes.plot(t_s, estimate, color=look_of("paper").tone.light, linewidth=0.8, linestyle="--", label="Algorithm 1")
    axes.axvline(TRAIN_SAMPLES / rate_hz, color="#8a949e", linewidth=0.8, linestyle=":")
    margin = 0.25 * float(np.ptp(arm))
    axes.set_ylim(float(arm.min()) - margin, float(arm.max()) + margin)
    axes.set_ylabel(f"position {name}")
