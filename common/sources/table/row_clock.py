"""Clock of a table's rows: order, rate and gaps of their times, and the instants that a run plays."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import scipy

from tis.common.errors import Fault
from tis.common.sources.hemisphere import one_hemisphere
from tis.common.sources.table.limits import MAX_SHOWN, capped
from tis.common.sources.trajectory import Array, PoseTrack

SECONDS_PER: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

_GAP_PERIODS: Final = 1.8  # one row that is missing leaves 2 periods
_RATE_TOLERANCE: Final = 0.005
_ON_GRID_S: Final = 1e-6


@dataclass(frozen=True)
class RowClock:
    """Times (N,) of the rows in s, from the first one, their rate, and the gaps as rows before them."""

    t_s: Array
    found_hz: float
    gaps: tuple[int, ...]

    def gaps_in_words(self) -> str:
        """Return number, place and length of the gaps."""
        lengths_s = [self.t_s[row + 1] - self.t_s[row] for row in self.gaps]
        shown = ", ".join(
            f"{self.t_s[row]:.3f} s (row {row}; {1e3 * length:.0f} ms)"
            for row, length in list(zip(self.gaps, lengths_s, strict=True))[:3]
        )
        rest = f" and {len(self.gaps) - 3} more" if len(self.gaps) > 3 else ""
        return f"{len(self.gaps)} {'gap' if len(self.gaps) == 1 else 'gaps'}, after {shown}{rest}"


@dataclass(frozen=True)
class Played:
    """Instants (M,) in s at which rows are interpolated, None where they are played as they are, and warnings."""

    at_s: Array | None
    warnings: tuple[str, ...] = ()


def row_clock(t_s: Array, where: str, column: str) -> tuple[RowClock | None, list[Fault]]:
    """Return the clock of finite times (N,) in s, N >= 2, or the faults of times that repeat or go back.

    The rate is that of the rows without the gaps; a gap is a step of 1.8 times the median or more. Oracle: grids
    with rows cut out, test_row_clock.
    """
    steps_s = np.diff(t_s)
    bad = np.flatnonzero(steps_s <= 0.0)
    if bad.size:
        rule = f"must be later than the row before (column {column}): sort the rows, or leave repeated ones out"
        found = [
            Fault(where, f"row {i + 1}", rule, f"{t_s[i + 1]:.9g} s after {t_s[i]:.9g} s") for i in bad[:MAX_SHOWN]
        ]
        return None, capped(found, len(bad), where, rule)
    long = steps_s > _GAP_PERIODS * float(np.median(steps_s))
    found_hz = 1.0 / float(steps_s[~long].mean())
    return RowClock(t_s - t_s[0], found_hz, tuple(int(i) for i in np.flatnonzero(long))), []


def played(
    clock: RowClock, rate_hz: int, resample: bool, gaps: Literal["refuse", "bridge"], where: str
) -> tuple[Played, list[Fault]]:
    """Return the instants that a run at ``rate_hz`` plays, or the faults of gaps and of another rate.

    Rows on the grid of ``rate_hz`` are played as they are. Oracle: test_row_clock.
    """
    faults, warnings = [], []
    if clock.gaps and gaps == "refuse":
        rule = "set source.gaps: bridge to play over them, or cut the table"
        faults.append(Fault(where, "", f"has {clock.gaps_in_words()}: {rule}"))
    elif clock.gaps:
        done = "interpolated" if resample else "played without the time that is missing"
        warnings.append(f"{clock.gaps_in_words()}: {done}")
    grid_s = np.arange(len(clock.t_s)) / rate_hz
    off_s = float(np.abs(clock.t_s - grid_s).max())
    if off_s <= _ON_GRID_S:
        return Played(None, tuple(warnings)), faults
    if resample:
        n = int(np.floor(clock.t_s[-1] * rate_hz + 1e-6)) + 1
        about = f"resampled from {clock.found_hz:.6g} rows a second to {rate_hz}: positions and angles linearly"
        warnings.append(f"{about}, orientations along great arcs")
        return Played(np.minimum(np.arange(n) / rate_hz, clock.t_s[-1]), tuple(warnings)), faults
    if abs(clock.found_hz / rate_hz - 1.0) > _RATE_TOLERANCE:
        nearest = round(clock.found_hz)
        same = f"rate_hz: {nearest}" if abs(clock.found_hz / max(nearest, 1) - 1.0) <= _RATE_TOLERANCE else ""
        choice = f"set {same}, or source.resample: true" if same else "set source.resample: true"
        rule = f"has {clock.found_hz:.6g} rows a second and the scenario's rate_hz is {rate_hz}: {choice}"
        return Played(None), [*faults, Fault(where, "", f"{rule} to interpolate rows at {rate_hz} Hz")]
    if not clock.gaps and off_s > 0.5 / rate_hz:
        warnings.append(
            f"its times depart from {rate_hz} rows a second by up to {1e3 * off_s:.0f} ms; rows are played evenly "
            "(source.resample: true interpolates them)"
        )
    return Played(None, tuple(warnings)), faults


def resampled(track: PoseTrack, t_s: Array, at_s: Array) -> PoseTrack:
    """Return the poses at instants (M,) within times (N,), in s: positions and angles linear, orientations by slerp.

    Shoemake, "Animating rotation with quaternion curves", 1985. Oracle: lines and
    a constant rotation, test_row_clock.
    """
    position = np.stack([np.interp(at_s, t_s, axis) for axis in track.position_m.T], axis=1)
    turns = scipy.spatial.transform.Rotation.from_quat(track.orientation)
    orientation = scipy.spatial.transform.Slerp(t_s, turns)(at_s).as_quat()
    return PoseTrack(position, one_hemisphere(orientation), np.interp(at_s, t_s, track.gripper_rad))
