"""Simulation of the paper: Algorithm 1 on the arrays of a whole trial, with delays drawn per sample."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.metrics.tracking import Scorable, score
from tis.common.sources.trajectory import HandRecording
from tis.common.streams import Stream
from tis.deploy.studies.paper.printed import PaperRow
from tis.patient_side.filters.paper_kalman import paper_filter
from tis.patient_side.linear_system import Array
from tis.patient_side.statespace import ArmModel

Reading = Literal["ms", "samples"]


@dataclass(frozen=True)
class Simulated:
    """Score of one simulation (names as in summary.json) and its mean drawn delay, in samples."""

    score: dict[str, Any]
    mean_delay_samples: float


class Track(NamedTuple):
    """One run of Algorithm 1: estimate (N, 3) in m, NaN where it diverged, and the delays (N,) in samples."""

    estimate_m: Array
    delays: NDArray[np.int64]


def run_algorithm(
    row: PaperRow, reading: Reading, model: ArmModel, hand: HandRecording, rate_hz: int, seed: int, as_printed: bool
) -> Track:
    """Run Algorithm 1 over all rows of ``hand``.

    The delay is ``round(n_d / dt + randn n_j / dt)``, halves away from zero as MATLAB rounds, with dt the sample
    period (``ms``) or 1 (``samples``). All variants of a row see the same draws.
    """
    n = len(hand.command)
    dt_ms = 1000.0 / rate_hz if reading == "ms" else 1.0
    u = {
        what: Stream.named(seed, f"paper/{row.number}/{what}").uniforms(0, n) for what in ("delay", "jitter", "loss")
    }
    delay_ms = row.low_ms + (row.high_ms - row.low_ms) * u["delay"] + row.jitter_ms * scipy.special.ndtri(u["jitter"])
    raw = delay_ms / dt_ms  # may be negative, as in the paper: it then reads the future
    delays = np.copysign(np.floor(np.abs(raw) + 0.5), raw).astype(np.int64)
    lost = u["loss"] <= row.loss_pct / 100
    estimate = paper_filter(
        hand.command.position_m - model.input_offset_m,
        hand.follower.position_m - model.output_offset_m,
        model.space,
        model.noise.Q,
        model.noise.R,
        delays,
        lost,
        as_printed=as_printed,
    )
    # The squares of a diverged filter overflow; such a row counts as missing.
    return Track(np.where(np.abs(estimate) < 1e100, estimate, np.nan) + model.output_offset_m, delays)


def simulate(
    row: PaperRow, reading: Reading, model: ArmModel, hand: HandRecording, rate_hz: int, seed: int, as_printed: bool
) -> Simulated:
    """Score a run of Algorithm 1 on all rows of ``hand``, in the sample that it was identified on."""
    found = run_algorithm(row, reading, model, hand, rate_hz, seed, as_printed)
    n, arm_m = len(hand.command), hand.follower.position_m
    used = np.clip(np.arange(n) - found.delays, 0, n - 1)
    everything = np.ones(n, dtype=np.bool_)
    range_m = model.output_high_m - model.output_low_m
    scored = score(Scorable(found.estimate_m, arm_m[used], arm_m, everything, range_m))
    return Simulated(dict(scored), float(found.delays.mean()))
