"""Examples for learned methods: training rows as a patient would see them, and what the linear forecast leaves.

Random rotations of examples: the hand has no preferred direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.common.streams import Stream
from tis.common.units import NS_PER_S
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.learned.inputs import Scaled, activity_of, scaled, stride_of, window_of_rows
from tis.patient_side.learned.predictor import MAX_AGE
from tis.patient_side.learned_model import Singles
from tis.patient_side.model_fields import Floats
from tis.patient_side.playout import Playout


def rotations(drawn: Floats) -> Singles:
    """Return rotation matrices (B, 3, 3), uniform over all, from uniforms (B, 3) (Shoemake 1992).

    Oracle: they are orthogonal, of determinant 1, and turn a vector into every direction alike.
    """
    a, b = np.sqrt(1.0 - drawn[:, 0]), np.sqrt(drawn[:, 0])
    s, t = 2.0 * np.pi * drawn[:, 1], 2.0 * np.pi * drawn[:, 2]
    quaternions = np.column_stack([a * np.sin(s), a * np.cos(s), b * np.sin(t), b * np.cos(t)])
    return np.asarray(scipy.spatial.transform.Rotation.from_quat(quaternions).as_matrix(), dtype=np.float32)


# Drawn arrivals of a trial's rows: the networks that learned methods are trained on.
#
# A fifth of the trials each: clean; losses one by one; losses in bursts (Gilbert-Elliott); delays of a few samples;
# delays of up to five seconds, as in the paper's worst row. Delays are drawn for each row alone, so rows overtake one
# another.

TICK_PHASE: Final = 0.06
"""Instant of a tick after its sample, in samples: 2 ms at 30 Hz."""
N_KINDS: Final = 5
LOST: Final = np.inf

_N_SETTINGS: Final = 4
_ALSO_LOST: Final = 0.02
"""Share of the rows that is lost where delays vary."""


def draw_arrivals(kind: int, n_rows: int, stream: Stream) -> Floats:
    """Return the instants (N,) at which rows arrive, in samples; infinite for lost ones.

    ``kind`` is 0 to 4, in the order above. Oracles in test_arrivals: mean loss, length of bursts, range of delays.
    """
    first, second, *_ = stream.uniforms(0, _N_SETTINGS).tolist()
    drawn = stream.uniforms(_N_SETTINGS, n_rows)
    delay = np.full(n_rows, TICK_PHASE)
    if kind == 1:
        delay[drawn < 0.02 + 0.48 * first] = LOST
    elif kind == 2:
        delay[_bursts(drawn, p_loss=0.02 + 0.28 * first, mean_burst=2.0 + 10.0 * second)] = LOST
    elif kind >= 3:
        shortest, spread = (3.0 * first, 1.0 + 9.0 * second) if kind == 3 else (10.0 * first, 10.0 + 140.0 * second)
        delay = shortest + spread * drawn
        delay[stream.uniforms(_N_SETTINGS + n_rows, n_rows) < _ALSO_LOST] = LOST
    return np.asarray(np.arange(n_rows) + delay)


def _bursts(drawn: Floats, p_loss: float, mean_burst: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the rows (N,) that a Gilbert-Elliott channel loses."""
    p_end = 1.0 / mean_burst
    p_begin = p_end * p_loss / (1.0 - p_loss)
    lost, is_bad = np.zeros(len(drawn), dtype=np.bool_), False
    for i, u in enumerate(drawn.tolist()):
        is_bad = u >= p_end if is_bad else u < p_begin
        lost[i] = is_bad
    return lost


N_AGES: Final = 4
"""Forecasts of each path: one to the tick, the others over drawn ages."""
FIRST_ROW: Final = 60
"""Rows of a trial before the first example, so that the filter has settled: 2 s at 30 Hz."""
EVERY: Final = 2
"""Steps from one example to the next: neighbours are nearly equal, and other networks tell more."""
_SHORTEST: Final = 0.06


class Track(NamedTuple):
    """One arm's rows of a trial: positions (N, 3) in m, gripper angles (N,) in rad, and who moves (or where)."""

    position_m: Floats
    gripper_rad: Floats
    group: str


@dataclass(frozen=True)
class Examples:
    """B paths with K forecasts each.

    ``window`` is the path in units of the hand's activity, ``ages`` (B, K) are in steps; ``moves`` and ``left``
    (B, K, 3) are what the linear model forecasts, and what it leaves of the truth, in units of its deviation and of
    that activity; ``unit_m`` (B, K) are these units. ``groups`` (B,) are the numbers of the tracks' ``names``.
    """

    window: Scaled
    ages: Floats
    moves: Singles
    left: Singles
    unit_m: Floats
    groups: NDArray[np.int64]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.ages)

    def rows(self, chosen: NDArray[np.int64]) -> "Examples":
        """Return the examples ``chosen``."""
        return Examples(
            window=Scaled(*(each[chosen] for each in self.window)),
            ages=self.ages[chosen],
            moves=self.moves[chosen],
            left=self.left[chosen],
            unit_m=self.unit_m[chosen],
            groups=self.groups[chosen],
            names=self.names,
        )

    @classmethod
    def joined(cls, parts: Sequence["Examples"]) -> "Examples":
        """Return the examples of all parts, which have the same names."""
        return cls(
            window=Scaled(*(np.concatenate(each) for each in zip(*(part.window for part in parts), strict=True))),
            ages=np.concatenate([part.ages for part in parts]),
            moves=np.concatenate([part.moves for part in parts]),
            left=np.concatenate([part.left for part in parts]),
            unit_m=np.concatenate([part.unit_m for part in parts]),
            groups=np.concatenate([part.groups for part in parts]),
            names=parts[0].names,
        )


class _Forecasts(NamedTuple):
    """Linear forecasts of one track: newest rows and ticks (B,), ages in samples, positions and units."""

    newest: NDArray[np.int64]
    now: Floats
    ages: Floats
    position_m: Floats
    unit_m: Floats


def examples_of(
    tracks: Sequence[Track],
    linear: InnovationsKf,
    usual_m: float,
    spread_rad: float,
    seed: int,
    n_passes: int,
    ages: Floats | None = None,
) -> Examples:
    """Return the examples of all tracks, each seen ``n_passes`` times through a network drawn anew.

    Each path has forecasts over ``ages``, in steps; by default over its own at the tick, and three that are drawn.
    Every kind of network serves every track in turn. Raises `DataError` where the tracks are too short.
    Oracle in test_examples: forecasts and truths worked out row by row, and no dependence on rows that have not
    arrived.
    """
    rate_hz = linear.model.rate_hz
    stride = stride_of(rate_hz)
    names = tuple(sorted({track.group for track in tracks}))
    parts = []
    for i in range(n_passes * len(tracks)):
        track = tracks[i % len(tracks)]
        stream = Stream.named(seed, f"learning/arrivals/{i}")
        arrival = draw_arrivals((i // len(tracks) + i % len(tracks)) % N_KINDS, len(track.position_m), stream)
        far = _drawn_ages(len(track.position_m), Stream.named(seed, f"learning/ages/{i}")) if ages is None else ages
        found = _forecasts(track, linear, arrival, far * stride, is_at_tick=ages is None)
        if not len(found.newest):
            continue
        path = window_of_rows(track.position_m, track.gripper_rad, arrival, found.newest, found.now, stride)
        activity = activity_of(path, usual_m)
        unit_m = found.unit_m * activity[:, None]
        moved = found.position_m - track.position_m[found.newest][:, None]
        truth = _between(track.position_m, found.newest[:, None] + found.ages)
        parts.append(
            Examples(
                scaled(path, activity, usual_m, spread_rad),
                np.minimum(found.ages / stride, MAX_AGE),
                (moved / unit_m[:, :, None]).astype(np.float32),
                ((truth - found.position_m) / unit_m[:, :, None]).astype(np.float32),
                unit_m,
                np.full(len(activity), names.index(track.group)),
                names,
            )
        )
    if not parts:
        furthest_s = MAX_AGE * stride / rate_hz if ages is None else float(ages.max()) * stride / rate_hz
        longest_s = max(len(track.position_m) for track in tracks) / rate_hz
        rule = f"must be longer than the furthest forecast that is learned, {furthest_s:.1f} s"
        raise DataError(Fault("training rows", "the longest stretch", rule, f"{longest_s:.1f} s"))
    return Examples.joined(parts)


def _drawn_ages(n_rows: int, stream: Stream) -> Floats:
    """Return ages (N, 3) in steps: every octave alike."""
    drawn = stream.uniforms(0, n_rows * (N_AGES - 1)).reshape(n_rows, N_AGES - 1)
    return np.asarray(_SHORTEST * (MAX_AGE / _SHORTEST) ** drawn)


def _forecasts(track: Track, linear: InnovationsKf, arrival: Floats, far: Floats, *, is_at_tick: bool) -> _Forecasts:
    """Return the linear forecasts at the ticks of a track, through a playout buffer, as in a run.

    Their ages are ``far`` (N, K) or (K,), in samples, and the age at the tick if ``is_at_tick``.
    """
    rate_hz, n_rows = linear.model.rate_hz, len(track.position_m)
    stride = stride_of(rate_hz)
    playout, state = Playout(rate_hz), linear.initial()
    order = np.argsort(arrival, kind="stable").tolist()
    angles = track.gripper_rad.tolist()
    later = np.broadcast_to(far, (n_rows, far.shape[-1])).tolist()
    newest, now, age_rows, positions, units, n_arrived = [], [], [], [], [], 0
    for k in range(n_rows - 1):
        tick = k + TICK_PHASE
        while n_arrived < n_rows and arrival[order[n_arrived]] <= tick:
            i = order[n_arrived]
            playout.arm.add(i, track.position_m[i], angles[i])
            n_arrived += 1
        index = playout.arm.newest
        if index < 0 or k % (EVERY * stride):
            continue
        some = [*([tick - index] if is_at_tick else []), *later[k]]
        found_m, unit_m = [], []
        for age in some:
            instant_ns = round((index + age) * NS_PER_S / rate_hz)
            state, estimate = linear.step(state, playout, instant_ns)
            assert estimate.position_m is not None, "a sample has arrived"
            assert estimate.covariance_m2 is not None, "a sample has arrived"
            found_m.append(estimate.position_m)
            pace = state.ring[-1].activity[0]
            unit_m.append(np.sqrt(np.trace(estimate.covariance_m2) / AXES / pace))
        if k < FIRST_ROW * stride or index + max(some) > n_rows - 1:
            continue
        newest.append(index)
        now.append(tick)
        age_rows.append(some)
        positions.append(found_m)
        units.append(unit_m)
    shape = len(newest), far.shape[-1] + is_at_tick
    return _Forecasts(
        np.array(newest, dtype=np.int64),
        np.array(now),
        np.array(age_rows).reshape(shape),
        np.array(positions).reshape(*shape, AXES),
        np.array(units).reshape(shape),
    )


def _between(position_m: Floats, instant: Floats) -> Floats:
    """Return the positions (..., 3) at instants in samples, linear between rows."""
    row = np.minimum(instant.astype(int), len(position_m) - 2)
    share = (instant - row)[..., None]
    return np.asarray((1.0 - share) * position_m[row] + share * position_m[row + 1])
