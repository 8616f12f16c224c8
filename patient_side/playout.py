"""The playout buffer: the arrived samples of one hand, sorted by source time.

Estimators read only this buffer, which makes them causal. Samples are addressed by their index at the source,
``round(sample_ns * rate_hz / 1e9)``; the order of arrival is kept as well, so that an estimator can find the samples
that are new since its last step. A sample may arrive several times: the first copy counts.

A device's stamps may be up to half a period beside the plan's instants. The buffer then states each sample at the
plan's instant, by a polynomial through it and its nearest arrived neighbours: all filters work on an even row. What
was sent stays readable, by `SourceBuffer.taken`.
"""

from bisect import bisect_left, bisect_right, insort
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isnan, nan, prod
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.units import NS_PER_S, sample_index, sample_instant_ns
from tis.patient_side.linear_system import Array

_NOWHERE: Final = (nan, nan, nan, nan)
_NEVER: Final = -(1 << 62)
_REACH: Final = 5
"""Samples to the farthest neighbour that the polynomial uses: across a longer gap a hand does not move like one."""
_N_NODES: Final = 5


class Taken(NamedTuple):
    """A sample as it was sent: its stamp less the plan's instant, in sample periods; position, and wrist (5,)."""

    late: float
    position_m: Array
    wrist: Array

    def wrist_like(self, other: "Taken") -> Array:
        """Return the wrist with the sign of its quaternion that is nearer to another one's."""
        return self.wrist if self.wrist[:4].dot(other.wrist[:4]) >= 0.0 else self.wrist * (-1, -1, -1, -1, 1)


@dataclass
class SourceBuffer:
    """The arrived samples of one stream: index at the source -> position (3,) in m.

    It keeps the newest ``depth`` indices; ``newest`` and ``last_arrived``, the index added last whatever its age, are
    -1 while nothing has arrived; ``n_added`` counts all samples added. ``get`` returns a sample's position, or None
    when it has not arrived. The gripper's angle in rad and the orientation, a unit quaternion (4,) x, y, z, w, are
    kept where the sample has them, in rings of arrays, from which a method reads many at once. Oracle: a plain list.
    All are stated at the plan's instants; ``uneven`` holds those with other stamps as they were sent.
    ``_at`` is the index at each place of the rings.
    """

    depth: int
    newest: int = -1
    last_arrived: int = -1
    n_added: int = 0
    get: Callable[[int], Array | None] = field(init=False, repr=False, compare=False)
    _samples: dict[int, Array] = field(default_factory=dict, repr=False)
    uneven: dict[int, Taken] = field(default_factory=dict, repr=False)
    _at: NDArray[np.int64] = field(init=False, repr=False, compare=False)
    _wrists: Array = field(init=False, repr=False, compare=False)
    _wrist_rows: list[tuple[float, ...]] = field(init=False, repr=False, compare=False)
    _mask: int = field(init=False, repr=False, compare=False)
    _indices: list[int] = field(default_factory=list, repr=False)
    _arrivals: deque[int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._arrivals = deque(maxlen=self.depth)
        self.get = self._samples.get  # the dict's own method, as estimators call it often
        n_places = 1 << (self.depth - 1).bit_length()  # so that a mask finds the place
        self._mask = n_places - 1
        self._at, self._wrists = np.full(n_places, _NEVER), np.full((n_places, 5), nan)
        self._wrist_rows = [(*_NOWHERE, nan)] * n_places

    def add(
        self,
        index: int,
        position_m: Array,
        gripper_rad: float | None = None,
        orientation: Sequence[float] | Array | None = None,
        late: float = 0.0,
    ) -> bool:
        """Add a sample, ``late`` periods after the plan's instant; False if it is known, negative or too old."""
        if index < 0 or index <= self.newest - self.depth or index in self._samples:
            return False
        self._samples[index] = position_m
        place = index & self._mask
        self._at[place] = index
        turn = orientation.tolist() if isinstance(orientation, np.ndarray) else orientation
        row = *(_NOWHERE if turn is None else turn), nan if gripper_rad is None else gripper_rad
        self._wrists[place] = self._wrist_rows[place] = row
        insort(self._indices, index)
        self.last_arrived = index
        self.n_added += 1
        self._arrivals.append(index)
        if index > self.newest:
            self.newest = index
            n_stale = bisect_right(self._indices, index - self.depth)
            for stale in self._indices[:n_stale]:
                del self._samples[stale]
                self.uneven.pop(stale, None)
            del self._indices[:n_stale]
        if late:
            self.uneven[index] = Taken(late, position_m, self._wrists[place].copy())
        if self.uneven:
            at = bisect_left(self._indices, index)
            for each in self._indices[max(0, at - _N_NODES + 1) : at + _N_NODES]:  # on whose polynomials it lies
                if each in self.uneven:
                    self._state_evenly(each)
        return True

    def taken(self, index: int) -> Taken:
        """Return an arrived sample as it was sent, not stated at the plan's instant."""
        even = self.uneven.get(index)
        return Taken(0.0, self._samples[index], self._wrists[index & self._mask].copy()) if even is None else even

    def at(self, index: int, late: float) -> Array | None:
        """Return the position at ``late`` periods after the plan's instant of a sample, None unless it has arrived.

        It lies on the polynomial through the sample and its nearest arrived neighbours, as they were sent.
        """
        if index not in self._samples or not (late or self.uneven):
            return self._samples.get(index)
        nodes, shares = self._around(index, late)
        return np.asarray(np.array(shares).dot([node.position_m for node in nodes]))

    def _around(self, index: int, late: float) -> tuple[list[Taken], list[float]]:
        """Return a sample and its nearest neighbours, and their shares in the polynomial's value at an instant."""
        own = self.taken(index)
        if own.late == late:
            return [own], [1.0]
        place = bisect_left(self._indices, index)
        first = max(0, min(place - _N_NODES // 2, len(self._indices) - _N_NODES))
        near = [each for each in self._indices[first : first + _N_NODES] if 0 < abs(each - index) <= _REACH]
        nodes = [own, *map(self.taken, near)]
        at = [each - index + node.late - late for each, node in zip((index, *near), nodes, strict=True)]
        return nodes, [prod(b / (b - a) for j, b in enumerate(at) if j != i) for i, a in enumerate(at)]

    def _state_evenly(self, index: int) -> None:
        """State a sample at the plan's instant. Oracle: a polynomial, which it gives exactly."""
        nodes, shares = self._around(index, 0.0)
        own = nodes[0]
        position_m = np.array(shares).dot([node.position_m for node in nodes])
        position_m.setflags(write=own.position_m.flags.writeable)
        self._samples[index] = position_m
        # Neighbouring orientations are alike but for the sign, so that their sum, of length 1, lies between them.
        wrist = sum(share * node.wrist_like(own) for share, node in zip(shares, nodes, strict=True))
        wrist = np.where(np.isnan(wrist), own.wrist, wrist)
        wrist[:4] /= max(float(np.linalg.norm(wrist[:4])), 1e-9)
        self._wrists[index & self._mask] = wrist
        self._wrist_rows[index & self._mask] = tuple(wrist.tolist())

    def __contains__(self, index: int) -> bool:
        """Return whether sample ``index`` has arrived and is still stored."""
        return index in self._samples

    def wrists(self, indices: NDArray[np.int64]) -> Array:
        """Return orientation and gripper (N, 5) at indices (N,) that have arrived, NaN where there is none."""
        return self._wrists.take(indices & self._mask, axis=0)

    def wrists_before(self, index: int, lags: Sequence[int]) -> list[tuple[float, ...]]:
        """Return the wrists (5,) at rising lags before an arrived sample, of a missing one the next newer one's."""
        samples, rows, mask = self._samples, self._wrist_rows, self._mask
        found = [rows[(index - lag) & mask] if index - lag in samples else () for lag in lags]
        if () in found:
            for i, each in enumerate(found):
                found[i] = each or (found[i - 1] if i else rows[index & mask])
        return found

    def all_arrived(self, indices: NDArray[np.int64]) -> bool:
        """Tell whether all of the falling indices (N,) have arrived and are still stored."""
        # The fastest comparison of few numbers is that of their bytes.
        known = self._at.take(indices & self._mask).tobytes() == indices.tobytes()
        return known and indices.item(-1) > self.newest - self.depth

    def arrived(self, indices: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Tell which of the indices (N,) have arrived and are still stored."""
        return np.asarray((self._at.take(indices & self._mask) == indices) & (indices > self.newest - self.depth))

    def positions_m(self, indices: NDArray[np.int64]) -> Array:
        """Return the positions (N, 3) at indices (N,) that have arrived."""
        return np.array([self._samples[index] for index in indices.tolist()])

    def orientation(self, index: int) -> Array | None:
        """Return the orientation (4,) at ``index``, None without one."""
        if index not in self._samples:
            return None
        found = self._wrists[index & self._mask, :4].copy()
        return None if isnan(found[0]) else found

    def gripper_rad(self, index: int) -> float | None:
        """Return the gripper's angle at ``index``, else at the arrived sample before it, else None."""
        found = self._gripper_rad(index)
        return self._gripper_rad(self.newest_before(index)) if found is None else found

    def _gripper_rad(self, index: int) -> float | None:
        if index not in self._samples:
            return None
        found = self._wrists.item(index & self._mask, 4)
        return None if isnan(found) else found

    def added_since(self, n_added: int) -> list[int]:
        """Return the indices added after the first ``n_added``, in order of arrival; at most the last ``depth``.

        `get` returns None for those that have become stale.
        """
        n_new = self.n_added - n_added
        if n_new < 2:
            return [self.last_arrived] if n_new else []
        n_new = min(n_new, len(self._arrivals))
        return [self._arrivals[i] for i in range(-n_new, 0)]

    def after(self, index: int) -> list[int]:
        """Return the arrived indices above ``index``, in order."""
        return self._indices[bisect_right(self._indices, index) :]

    def newest_before(self, index: int) -> int:
        """Return the newest arrived index below ``index``, or -1."""
        at = bisect_left(self._indices, index)
        return self._indices[at - 1] if at else -1

    def oldest_after(self, index: int) -> int:
        """Return the oldest arrived index above ``index``, or -1."""
        at = bisect_right(self._indices, index)
        return self._indices[at] if at < len(self._indices) else -1


@dataclass
class Playout:
    """The arrived samples of one hand: commands u and, when the source is a recording, arm positions y.

    ``other_arm`` holds those of the other hand's arm, where the run has both: to read, and never to add to.
    """

    rate_hz: int
    depth: int = 4096
    other_arm: SourceBuffer | None = field(default=None, repr=False, compare=False)
    command: SourceBuffer = field(init=False)
    arm: SourceBuffer = field(init=False)

    def __post_init__(self) -> None:
        self.command = SourceBuffer(self.depth)
        self.arm = SourceBuffer(self.depth)

    def index(self, sample_ns: int) -> int:
        """Return the source index of a sample instant."""
        return sample_index(sample_ns, self.rate_hz)

    def late(self, index: int, sample_ns: int) -> float:
        """Return how many periods after the plan's instant a sample was taken, negative before it."""
        return (sample_ns - sample_instant_ns(index, self.rate_hz)) * self.rate_hz / NS_PER_S

    def periods_ns(self, n: float) -> int:
        """Return the length of ``n`` sample periods in ns."""
        return round(n * NS_PER_S / self.rate_hz)

    def age_samples(self, index: int, now_ns: int) -> float:
        """Return the age of sample ``index`` at ``now_ns`` in sample periods, with fractions."""
        return (now_ns - sample_instant_ns(index, self.rate_hz)) * self.rate_hz / 1e9
