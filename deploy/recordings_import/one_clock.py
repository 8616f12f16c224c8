"""Streams of different instants on one clock: the rows of a table. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.sources.table_columns import MAX_ROWS, MIN_ROWS
from tis.common.sources.table_poses import resampled
from tis.common.sources.trajectory import PoseTrack
from tis.common.units import NS_PER_S
from tis.deploy.recordings_import.found import MASTERS, Array, Found, Ints, Jaw, Stream

_GAP_PERIODS: Final = 1.8  # as of tables: one message that is missing leaves 2 periods
_SHOWN: Final = 3


@dataclass(frozen=True)
class Device:
    """Poses of one device at the rows of a table; whether orientation and gripper were recorded."""

    name: str
    track: PoseTrack
    turns: bool
    grips: bool


@dataclass(frozen=True)
class Rows:
    """Instants (N,) of the rows in s from the first, the devices, the rows per second, notes, and further columns."""

    t_s: Array
    devices: tuple[Device, ...]
    rate_hz: float
    notes: tuple[str, ...]
    extras: Mapping[str, Array]


def on_one_clock(found: Found, rate_hz: float | None, where: str) -> Rows:
    """Return the streams at common instants.

    Streams of the same instants keep them where no other rate is requested. Others are interpolated (positions and
    angles linearly, orientations by slerp) at ``rate_hz``, by default that of the first master, while all are there.
    Rows within a gap of any stream are left out, never interpolated. Raises `DataError` where nothing is common.
    Oracle: sines at shifted instants, test_one_clock.
    """
    streams = sorted(found.streams, key=lambda stream: stream.device not in MASTERS)
    notes = [_rate_of(stream.origin, stream.t_ns) for stream in streams]
    shared = streams[0].t_ns
    all_ns = [stream.t_ns for stream in streams] + [jaw.t_ns for jaw in found.jaws]
    own_hz = NS_PER_S / float(np.median(np.diff(shared)))
    same = all(np.array_equal(t_ns, shared) for t_ns in all_ns)
    if same and (rate_hz is None or abs(rate_hz / own_hz - 1.0) < 1e-4):
        t_s = (shared - shared[0]) / NS_PER_S
        notes += _gaps(shared, streams[0].origin)[1]
        whose = "its" if len(all_ns) == 1 else "all have the same"
        notes.append(f"{whose} {len(shared)} instants{', which' if len(all_ns) > 1 else ''} are kept")
        if rate_hz is None:
            rate_hz = _whole(own_hz)
        grid_s = np.arange(len(t_s)) / rate_hz
        if float(np.abs(t_s - grid_s).max()) < 1e-8:
            t_s = grid_s  # instants of whole ns, without their rounding
        devices = tuple(_device(stream, found.jaws, shared) for stream in streams)
        return Rows(t_s, devices, rate_hz, tuple(notes), _extras(found, shared))
    rate_hz = _whole(own_hz) if rate_hz is None else rate_hz
    at_ns = _grid(all_ns, rate_hz, where)
    within = np.zeros(len(at_ns), dtype=bool)
    for origin, t_ns in [(s.origin, s.t_ns) for s in streams] + [(jaw.origin, jaw.t_ns) for jaw in found.jaws]:
        gaps, words = _gaps(t_ns, origin)
        notes += words
        for begin_ns, end_ns in gaps:
            within |= (at_ns > begin_ns) & (at_ns < end_ns)
    kept = at_ns[~within]
    if len(kept) < MIN_ROWS:
        raise DataError(Fault(where, "", f"must have {MIN_ROWS} rows outside of gaps", len(kept)))
    notes.append(f"interpolated at {rate_hz:g} rows a second, {len(kept)} rows while all streams are there")
    if within.any():
        notes.append(f"{int(within.sum())} rows within gaps are left out: a run refuses the table, or bridges them")
    t_s = np.flatnonzero(~within) / rate_hz
    devices = tuple(_device(stream, found.jaws, kept) for stream in streams)
    return Rows(t_s - t_s[0], devices, rate_hz, tuple(notes), _extras(found, kept))


def _extras(found: Found, at_ns: Ints) -> dict[str, Array]:
    """Return the further columns at the rows' instants, linearly between their own; NaN before and after these."""
    begin_ns = at_ns[0]
    return {
        extra.column: extra.values
        if np.array_equal(extra.t_ns, at_ns)
        else np.interp(
            (at_ns - begin_ns).astype(float), (extra.t_ns - begin_ns).astype(float), extra.values, np.nan, np.nan
        )
        for extra in found.extras
    }


def _whole(rate_hz: float) -> float:
    nearest = round(rate_hz)
    return float(nearest) if nearest and abs(rate_hz / nearest - 1.0) < 0.01 else rate_hz


def _grid(all_ns: Sequence[Ints], rate_hz: float, where: str) -> Ints:
    first = max(int(t_ns[0]) for t_ns in all_ns)
    last = min(int(t_ns[-1]) for t_ns in all_ns)
    if last <= first:
        raise DataError(Fault(where, "", "holds streams that have no time in common"))
    n_rows = int((last - first) * rate_hz / NS_PER_S + 1e-6) + 1
    if n_rows > MAX_ROWS:
        raise DataError(Fault(where, "", f"must give at most {MAX_ROWS} rows at {rate_hz:g} a second", n_rows))
    return first + np.minimum(np.round(np.arange(n_rows) * (NS_PER_S / rate_hz)).astype(np.int64), last - first)


def _rate_of(origin: str, t_ns: Ints) -> str:
    steps_ns = np.diff(t_ns)
    _, words = _gaps(t_ns, origin)
    mean_hz = NS_PER_S / float(steps_ns[steps_ns <= _GAP_PERIODS * float(np.median(steps_ns))].mean())
    about = f"{origin}: {len(t_ns)} poses in {(t_ns[-1] - t_ns[0]) / NS_PER_S:.3f} s, {mean_hz:.6g} a second"
    return f"{about}{' outside of gaps' if words else '; no gap'}"


def _gaps(t_ns: Ints, origin: str) -> tuple[list[tuple[int, int]], list[str]]:
    steps_ns = np.diff(t_ns)
    long = np.flatnonzero(steps_ns > _GAP_PERIODS * float(np.median(steps_ns)))
    if not len(long):
        return [], []
    shown = ", ".join(
        f"{(t_ns[i] - t_ns[0]) / NS_PER_S:.3f} s ({steps_ns[i] / 1e6:.0f} ms)" for i in long[:_SHOWN].tolist()
    )
    rest = f" and {len(long) - _SHOWN} more" if len(long) > _SHOWN else ""
    words = f"{origin}: {len(long)} {'gap' if len(long) == 1 else 'gaps'}, after {shown}{rest}"
    return [(int(t_ns[i]), int(t_ns[i + 1])) for i in long], [words]


def _device(stream: Stream, jaws: Sequence[Jaw], at_ns: Ints) -> Device:
    begin_ns = int(stream.t_ns[0])
    jaw = next((each for each in jaws if each.device == stream.device), None)
    n = len(stream.t_ns)
    orientation = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)) if stream.orientation is None else stream.orientation
    gripper = np.zeros(n) if stream.gripper_rad is None else stream.gripper_rad
    track = PoseTrack(stream.position_m, orientation, gripper)
    if not np.array_equal(at_ns, stream.t_ns):
        track = resampled(track, (stream.t_ns - begin_ns) / NS_PER_S, (at_ns - begin_ns) / NS_PER_S)
    if jaw is not None:
        angles = np.interp((at_ns - begin_ns).astype(float), (jaw.t_ns - begin_ns).astype(float), jaw.gripper_rad)
        track = PoseTrack(track.position_m, track.orientation, angles)
    return Device(
        stream.device, track, stream.orientation is not None, jaw is not None or stream.gripper_rad is not None
    )
