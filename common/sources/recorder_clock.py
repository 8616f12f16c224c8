"""The instants of a recording whose rows are the latest samples of a recorder at another rate, and even rows of it.

All JIGSAWS trials that were looked at are rows of 30 Hz from a recorder of 51.33 Hz: each row shows its latest
sample, so that neighbouring rows are one or two of its samples apart. Played as they are, such rows make a hand that
slows down at every third or fourth row, as no hand does and no device states.

Row i shows sample ``floor(i r + phase)`` of a recorder with r samples a row. The lines in the spectrum of the rows'
relative increments tell r but for whole numbers and the sign; of the clocks that they leave, the one counts on which
the velocity changes least from row to row.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import scipy

from tis.common.sources.trajectory import Array, HandRecording, PoseTrack

_N_LINES: Final = 6
_MOST_WHOLE: Final = 3
_LOWEST: Final = 0.02
"""Frequency, in cycles a row, below which a line is the hand's own."""
_PHASES: Final = np.arange(0.0, 1.0, 1.0 / 16)
_LARGEST: Final = 0.93
"""Share of the changes of velocity left at most where there is a clock: .50 to .86 in 23 trials of JIGSAWS."""
_MIN_ROWS: Final = 300
_N_LIKELY: Final = 4
_ALIKE: Final = 0.02
_BINS: Final = 3
"""Bins of the spectrum by which a weak line may be off."""
_AS_GOOD: Final = 1.01
"""Of clocks that differ by less the slowest counts."""
_AT_REST: Final = 0.02


class RecorderClock(NamedTuple):
    """Samples of the recorder a row, and its phase at row 0, in samples."""

    samples_a_row: float
    phase: float

    def instants(self, n_rows: int) -> Array:
        """Return the instants (N,) at which the rows were taken, in rows, on average those of an even clock."""
        taken = np.floor(np.arange(n_rows) * self.samples_a_row + self.phase) / self.samples_a_row
        return np.asarray(taken - np.mean(taken - np.arange(n_rows)))


def find_clock(positions_m: Sequence[Array]) -> RecorderClock | None:
    """Return the clock behind rows of devices that were recorded together, each (N, 3); None for even rows.

    Oracle: rows picked from a movement by a known clock, and rows of an even one.
    """
    moving = [each for each in positions_m if len(each) >= _MIN_ROWS and np.ptp(each, axis=0).any()]
    if not moving:
        return None
    n_fft = 1 << (4 * len(moving[0])).bit_length()
    rates = {
        whole + sign * line
        for line in _lines(moving, n_fft)
        for whole in range(1, _MOST_WHOLE + 1)
        for sign in (-1, 1)
        if whole + sign * line > 1.0
    }
    # The first rows leave a few rates, all rows one of them, and its exact phase.
    first = [each[: 2 * _MIN_ROWS] for each in moving]
    least = {
        rate: min(_unsteadiness(first, RecorderClock(rate, float(phase))) for phase in _PHASES) for rate in rates
    }
    likely: list[float] = []
    for rate in sorted(rates, key=lambda each: least[each]):
        if len(likely) < _N_LIKELY and all(abs(rate - other) > _ALIKE for other in likely):
            likely.append(rate)
    found = [
        min(
            (
                RecorderClock(rate + float(step) / n_fft, float(phase))
                for step in np.linspace(-_BINS, _BINS, 8 * _BINS + 1)
                for phase in _PHASES
            ),
            key=lambda each: _unsteadiness(moving, each),
        )
        for rate in sorted(likely)
    ]
    least_of_all = min(_unsteadiness(moving, each) for each in found)
    best = next(each for each in found if _unsteadiness(moving, each) <= _AS_GOOD * least_of_all)
    for span in (1.0, 0.5, 0.25, 0.125):  # of what the grid leaves
        nearer = [
            RecorderClock(
                best.samples_a_row + float(step) * span / (4 * n_fft), best.phase + float(later) * span / 16
            )
            for step in np.linspace(-1.0, 1.0, 7)
            for later in np.linspace(-1.0, 1.0, 7)
        ]
        best = min(nearer, key=lambda each: _unsteadiness(moving, each))
    return best if _unsteadiness(moving, best) < _LARGEST * _unsteadiness(moving, RecorderClock(1.0, 0.0)) else None


def _lines(positions_m: Sequence[Array], n_fft: int) -> list[float]:
    """Return the strongest lines in the relative excess of increments over neighbours, in cycles a row."""
    power = np.zeros(n_fft // 2 + 1)
    for each in positions_m:
        moved = np.diff(each, axis=0)
        usual = (2.0 * moved[1:-1] + moved[:-2] + moved[2:]) / 4.0
        square = np.sum(usual**2, axis=1)
        excess = np.sum(moved[1:-1] * usual, axis=1) - square
        excess = np.clip(excess / (square + _AT_REST * np.mean(np.sum(moved**2, axis=1)) + 1e-30), -1.0, 1.0)
        power += np.abs(np.fft.rfft(excess - excess.mean(), n_fft)) ** 2
    power[: int(_LOWEST * n_fft)] = 0.0
    lines, width = [], 16
    for _ in range(_N_LINES):
        at = int(power.argmax())
        lines.append(at / n_fft)
        power[max(0, at - width) : at + width] = 0.0
    return lines


def _unsteadiness(positions_m: Sequence[Array], clock: RecorderClock) -> float:
    """Return the mean change of velocity from row to row, over the mean speed: a jump counts as other changes do."""
    steps = np.diff(clock.instants(len(positions_m[0])))[:, None]
    total = 0.0
    for each in positions_m:
        velocity = np.diff(each, axis=0) / steps
        speed = float(np.sum(np.sqrt(np.sum(velocity**2, axis=1))))
        total += float(np.sum(np.sqrt(np.sum(np.diff(velocity, axis=0) ** 2, axis=1)))) / speed
    return total


def even_hand(hand: HandRecording, clock: RecorderClock) -> HandRecording:
    """Return a hand's rows at even instants, by cubic splines through the rows at their own."""
    velocity = hand.command_velocity_m_s
    return replace(
        hand,
        command=_even_track(hand.command, clock),
        follower=_even_track(hand.follower, clock),
        command_velocity_m_s=None if velocity is None else _even_rows(velocity, clock),
    )


def _even_track(track: PoseTrack, clock: RecorderClock) -> PoseTrack:
    turned = _even_rows(track.orientation, clock)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return PoseTrack(_even_rows(track.position_m, clock), turned, _even_rows(track.gripper_rad, clock))


def _even_rows(values: Array, clock: RecorderClock) -> Array:
    instants = clock.instants(len(values))
    at = np.clip(np.arange(len(values)), instants[0], instants[-1])
    return np.asarray(scipy.interpolate.CubicSpline(instants, values)(at))
