"""Figures of the last seconds of a run: delay, loss, latency and error."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Final

import numpy as np

from tis.common.units import MM_PER_M, NS_PER_MS
from tis.deploy.watch.arms import DisplayErrors, TrackRow
from tis.deploy.watch.streams import Crossing, StreamName

MAX_UNSEEN_PCT: Final = 2.0
"""Share of unseen packets above which the observer cannot tell loss."""

_LEAST_HOLD_MM: Final = 1e-3
"""Error of hold below which the arm rests, and nothing is to be compared with."""


@dataclass(frozen=True)
class CrossingFigures:
    """Count, loss and median delay, ms, of the packets of one stream; ``n_lost`` None where it cannot be told."""

    n: int = 0
    n_lost: int | None = 0
    delay_p50_ms: float | None = None

    @property
    def loss_pct(self) -> float | None:
        """Return the loss in percent; None without packets."""
        return 100 * self.n_lost / self.n if self.n and self.n_lost is not None else None


@dataclass(frozen=True)
class LiveFigures:
    """Figures of a run from outside: ``streams`` by name; latency in ms, errors in mm (3D RMSE) and degrees."""

    streams: Mapping[StreamName, CrossingFigures] = field(default_factory=dict)
    end_to_end_p50_ms: float | None = None
    end_to_end_p99_ms: float | None = None
    rmse_mm: float | None = None
    hold_rmse_mm: float | None = None
    turn_rms_deg: float | None = None
    hold_turn_rms_deg: float | None = None
    display: DisplayErrors | None = None
    extent_mm: float | None = None
    """Longest edge of the box that an arm's true motion fills, of all arms, in mm."""
    age_max_ms: float | None = None
    """Largest age of the newest sample at a tick, in ms."""
    gap_max_ms: float | None = None
    """Longest time, of all arms, in which no newer sample reached the patient, in ms."""
    silent_s: float | None = None
    """Time for which no command has reached the patient, in s; None where that is not long."""
    display_silent_s: float | None = None
    """The same of answers that reach the surgeon's display."""
    now_s: float = 0.0
    """Run time of the newest message that the observer has taken, in s; 0: it has taken none."""
    unseen_pct: float = 0.0
    """Share of the packets that the observer did not see on their network of origin, in percent."""

    def loss_pct(self, *names: StreamName) -> float | None:
        """Return the loss of these streams together, in percent; None without packets or where it cannot be told."""
        rows = [self.streams[name] for name in names if name in self.streams]
        if not rows or any(row.n_lost is None for row in rows):
            return None
        return CrossingFigures(sum(row.n for row in rows), sum(row.n_lost or 0 for row in rows)).loss_pct

    @property
    def keeps_up(self) -> bool:
        """Tell whether the observer sees nearly all packets: only then is one that it misses a lost one."""
        return self.unseen_pct <= MAX_UNSEEN_PCT

    @property
    def limit_text(self) -> str:
        """Return a sentence on an observer that cannot keep up; "" for one that does."""
        if self.keeps_up:
            return ""
        return (
            f"No loss is shown: the observer cannot keep up, it did not see {self.unseen_pct:.0f} % of the packets."
        )

    @property
    def ratio_to_hold(self) -> float | None:
        """Return the estimate's error over hold's; below 1 is better than hold. Beside an arm at rest it is None."""
        if self.rmse_mm is None or self.hold_rmse_mm is None or self.hold_rmse_mm < _LEAST_HOLD_MM:
            return None
        return self.rmse_mm / self.hold_rmse_mm


def crossing_figures(crossings: Iterable[Crossing]) -> CrossingFigures:
    """Return the figures of packets (oracle: hand-computed, tests/deploy/watch/test_live_figures)."""
    rows = list(crossings)
    delays_ms = [row.delay_ns / NS_PER_MS for row in rows if row.delay_ns is not None]
    n_lost = len(rows) - len(delays_ms)
    (p50_ms,) = _quantiles(delays_ms, 50)
    return CrossingFigures(len(rows), n_lost, p50_ms)


def live_figures(
    streams: Mapping[StreamName, Iterable[Crossing]],
    end_to_end_ms: Sequence[float],
    tracks: Sequence[Sequence[TrackRow]],
    n_unseen: int = 0,
    display: DisplayErrors | None = None,
    ages_ms: Sequence[float] = (),
) -> LiveFigures:
    """Return the figures of the rows of a time window, ``tracks`` by arm; ``n_unseen`` packets were not seen."""
    ticks = [row for track in tracks for row in track]
    found = {name: crossing_figures(rows) for name, rows in streams.items()}
    n_seen = sum(one.n for one in found.values())
    unseen_pct = 100 * n_unseen / (n_unseen + n_seen) if n_unseen else 0.0
    if unseen_pct > MAX_UNSEEN_PCT:
        found = {name: replace(one, n_lost=None) for name, one in found.items()}
    end_to_end_p50_ms, end_to_end_p99_ms = _quantiles(end_to_end_ms, 50, 99)
    return LiveFigures(
        streams=found,
        end_to_end_p50_ms=end_to_end_p50_ms,
        end_to_end_p99_ms=end_to_end_p99_ms,
        rmse_mm=_rms([row.error_mm for row in ticks]),
        hold_rmse_mm=_rms([row.hold_error_mm for row in ticks]),
        turn_rms_deg=_rms([row.turn_error_deg for row in ticks if row.turn_error_deg is not None]),
        hold_turn_rms_deg=_rms([row.hold_turn_error_deg for row in ticks if row.hold_turn_error_deg is not None]),
        display=display,
        extent_mm=max((_extent_mm(track) for track in tracks if track), default=None),
        age_max_ms=max(ages_ms, default=None),
        unseen_pct=unseen_pct,
    )


def _extent_mm(track: Sequence[TrackRow]) -> float:
    places_m = np.array([row.truth_m for row in track])
    return float(MM_PER_M * np.ptp(places_m, axis=0).max())


def _quantiles(values: Sequence[float], *percents: int) -> list[float | None]:
    if not values:
        return [None] * len(percents)
    return [float(value) for value in np.percentile(values, percents)]


def _rms(values: Sequence[float]) -> float | None:
    return sqrt(sum(value * value for value in values) / len(values)) if values else None
