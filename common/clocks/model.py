"""Conversion of a host's clock to the reference clock, with a bound on the error."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.clocks.exchange import Ints

Floats = NDArray[np.float64]

PPM: Final = 1e-6


@dataclass(frozen=True)
class Envelope:
    """Upper limit of a function whose rate of change is at most ``rate``, given at knots.

    ``at_ns`` (M,) ascending, ``limit_ns`` (M,).
    """

    at_ns: Ints
    limit_ns: Floats
    rate: float

    @classmethod
    def tightest(cls, at_ns: Ints, limit_ns: Floats, rate: float) -> Self:
        """Return the tightest envelope: each knot is also bounded by any other's limit plus rate * distance.

        Two passes, as in a distance transform (oracle: the minimum over all pairs, tests/common/clocks/test_model).
        """
        away = rate * (at_ns - at_ns[0])
        from_before = np.minimum.accumulate(limit_ns - away) + away
        from_after = np.minimum.accumulate((limit_ns + away)[::-1])[::-1] - away
        return cls(at_ns, np.minimum(from_before, from_after), rate)

    def limit_at(self, ns: Ints) -> Floats:
        """Return the limit at instants (N,), extrapolated beyond the first and the last knot."""
        after = np.searchsorted(self.at_ns, ns)
        left, right = np.maximum(after - 1, 0), np.minimum(after, len(self.at_ns) - 1)
        by_knot = [self.limit_ns[knot] + self.rate * np.abs(ns - self.at_ns[knot]) for knot in (left, right)]
        limit: Floats = np.minimum(*by_knot)
        return limit


@dataclass(frozen=True)
class ClockModel:
    """Offset of the reference over a host's clock: ``offset_ns`` at ``at_ns``, with a constant ``drift``.

    ``drift`` is the reference's gain per ns of this host. ``above`` and ``below`` limit the distance of the true
    offset from that line. Without limits the clock is shared: it is the reference itself.
    """

    at_ns: int = 0
    offset_ns: float = 0.0
    drift: float = 0.0
    drift_bound: float = 0.0
    above: Envelope | None = None
    below: Envelope | None = None

    @property
    def shared(self) -> bool:
        """Tell whether this is the reference clock itself."""
        return self.above is None

    def offset_at(self, own_ns: Ints) -> Floats:
        """Return the offset of the reference at instants (N,) of this host, in ns."""
        since_ns = (np.asarray(own_ns, dtype=np.int64) - self.at_ns).astype(np.float64)
        return self.offset_ns + self.drift * since_ns

    def to_reference_ns(self, own_ns: Ints) -> Ints:
        """Return instants (N,) of this host on the reference's clock, to the nearest ns; unchanged if shared.

        Oracle: a clock with a known offset and drift (tests/common/clocks/test_fit).
        """
        own_ns = np.asarray(own_ns, dtype=np.int64)
        return own_ns if self.shared else own_ns + np.rint(self.offset_at(own_ns)).astype(np.int64)

    def uncertainty_ns(self, own_ns: Ints) -> Ints:
        """Return the bound on the error of `to_reference_ns` at instants (N,), in ns; 0 for a shared clock.

        A strict bound, not a standard deviation: see `tis.common.clocks.fit`.
        """
        own_ns = np.asarray(own_ns, dtype=np.int64)
        if self.above is None or self.below is None:
            return np.zeros_like(own_ns)
        either = np.maximum(self.above.limit_at(own_ns), self.below.limit_at(own_ns))
        return np.ceil(np.maximum(either, 0)).astype(np.int64) + 1  # one for the rounding to whole ns

    def from_reference_ns(self, reference_ns: Ints) -> Ints:
        """Return the readings of this host's clock at instants (N,) of the reference's, to the nearest ns."""
        reference_ns = np.asarray(reference_ns, dtype=np.int64)
        if self.shared:
            return reference_ns
        since_ns = (reference_ns - self.at_ns).astype(np.float64) - self.offset_ns
        return self.at_ns + np.rint(since_ns / (1 + self.drift)).astype(np.int64)

    def uncertainty_at_ns(self, reference_ns: Ints) -> Ints:
        """Return `uncertainty_ns` at instants (N,) of the reference's clock."""
        return self.uncertainty_ns(self.from_reference_ns(reference_ns))


SHARED: Final = ClockModel()
"""The model of the reference clock itself."""
