"""A run as its page and its figures show it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from tis.common.channels import FOLLOWER, Arm, Hand
from tis.common.scenario import Scenario
from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.thinning import Indices, column, evenly, worst
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.subjects.age import ages_at_ms
from tis.deploy.report.subjects.identification import IdentifiedModel
from tis.deploy.report.subjects.network.disturbances import Disturbance, disturbances
from tis.deploy.report.subjects.tracking import Array, HandTrack
from tis.deploy.report.summary import Summary

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource

MAX_TICKS = 3000
"""Ticks that are drawn, more than a screen has columns; longer runs are thinned to the worst and evenly spaced."""


@dataclass(frozen=True)
class HandView:
    """The data to draw of one hand; ``active`` is the estimator that the patient acts on.

    ``errors_mm`` are the estimators' distances to the truth (T,), ``age_ms`` (T,) is the age of the freshest sample,
    NaN for unknown. ``kept`` are the ticks that are drawn. ``turns_deg`` are the angles (T,) of the orientation
    methods to the truth, ``active_orientation`` the method that the answers carry.
    """

    hand: Hand
    title: str
    track: HandTrack
    active: str
    errors_mm: dict[str, Array]
    age_ms: Array
    kept: Indices
    active_orientation: str
    turns_deg: dict[str, Array]

    @cached_property
    def source(self) -> "ColumnDataSource":
        """Return the data source of all figures of the hand, so that the page holds it once.

        Columns ``t`` in s, ``age`` in ms, for each name ``NAME x`` to ``NAME z`` and ``NAME error`` in mm, and for
        each orientation method ``NAME turn`` in degrees.
        """
        from bokeh.models import ColumnDataSource

        kept, track = self.kept, self.track
        data = {"t": column(track.t_ns[kept] / NS_PER_S), "age": column(self.age_ms[kept])}
        for name, position_m in self.lines_m.items():
            data |= {f"{name} {axis}": column(MM_PER_M * position_m[kept, i]) for i, axis in enumerate("xyz")}
        data |= {f"{name} error": column(error_mm[kept]) for name, error_mm in self.errors_mm.items()}
        return ColumnDataSource(data | {f"{n} turn": column(deg[kept]) for n, deg in self.turns_deg.items()})

    @property
    def lines_m(self) -> dict[str, Array]:
        """Return the positions (T, 3) by name, the truth first."""
        return {"truth": self.track.truth_m, **self.track.estimates}

    @property
    def n_ticks(self) -> int:
        """Return the number of ticks, drawn or not."""
        return len(self.track.t_ns)

    def scored(self, errors: Mapping[str, Array], name: str) -> Array:
        """Return the errors (T,) of one name at the scored ticks, NaN at the others and for a name without any."""
        return np.where(self.track.scored, errors.get(name, np.nan), np.nan)

    def thinning_note(self) -> str:
        """Return a sentence on ticks that are not drawn, "" when all are."""
        if len(self.kept) == self.n_ticks:
            return ""
        return f" Of {self.n_ticks} ticks {len(self.kept)} are drawn, the worst of each stretch among them."


def hand_view(run: MeasuredRun, hand: Hand, title: str) -> HandView:
    """Return one hand's view as far as its logs reach (oracle: logs written by hand, test_hand_view)."""
    track, scenario = run.tracks[hand], run.scenario
    errors_mm, age_ms = track.errors_mm, ages_at_ms(run.logs, hand, track.t_ns)
    kept = _kept(errors_mm, len(track.t_ns))
    active, turning = scenario.active_estimator, scenario.patient.orientation.active
    return HandView(hand, title, track, active, errors_mm, age_ms, kept, turning, run.wrists[hand].turns_deg)


def _kept(errors_mm: dict[str, Array], n: int) -> Indices:
    if n <= MAX_TICKS or not errors_mm:
        return evenly(n, MAX_TICKS)
    # one selection for all estimators, so that all lines share a source
    largest_mm = np.fmax.reduce(list(errors_mm.values()))
    kept = np.union1d(evenly(n, MAX_TICKS // 2), worst(largest_mm, MAX_TICKS // 2 - len(errors_mm)))
    # captions name the largest error of each estimator, where another one's may be larger
    return np.union1d(kept, [int(np.nanargmax(mm)) for mm in errors_mm.values() if np.isfinite(mm).any()])


@dataclass(frozen=True)
class RunView:
    """A run, its summary, and the versions of the packages that it used."""

    measured: MeasuredRun
    summary: Summary
    versions: dict[str, str | None]

    @classmethod
    def of(cls, run: MeasuredRun, summary: Summary, manifest: Mapping[str, Any]) -> Self:
        """Return the view of a run, with the versions in its manifest."""
        arms = arms_of(run.scenario, run.arms)
        found = manifest.get("versions")
        versions = {"python": manifest.get("python"), **found} if isinstance(found, dict) else {}
        return cls(run if arms == run.arms else replace(run, arms=arms), summary, versions)

    @property
    def logs(self) -> RunLogs:
        """Return the logs."""
        return self.measured.logs

    @property
    def scenario(self) -> Scenario:
        """Return the scenario."""
        return self.measured.scenario

    @property
    def synthetic(self) -> bool:
        """Return whether the movement is synthetic, not recorded from a person."""
        recording = self.summary.recording
        return self.scenario.source.synthetic or (recording is not None and recording.synthetic)

    @property
    def mark(self) -> str:
        """Return the mark beside the title of each section that shows the movement."""
        return "synthetic" if self.synthetic else ""

    @property
    def models(self) -> dict[Hand, IdentifiedModel]:
        """Return the figures of the identified model of each hand."""
        single = self.summary.identification
        return self.summary.identification_by_hand or ({self.scenario.source.hands[0]: single} if single else {})

    @cached_property
    def hands(self) -> dict[Hand, HandView]:
        """Return the view of each hand."""
        origin = ", synthetic" if self.synthetic else ""
        return {
            hand: hand_view(self.measured, hand, f"{hand} hand ({arm}{origin})")
            for hand, arm in self.measured.arms.items()
        }

    @cached_property
    def disturbances(self) -> list[Disturbance]:
        """Return what disturbed the network while the run lasted."""
        return disturbances(self.logs, self.scenario)


def arms_of(scenario: Scenario, found: dict[Hand, Arm]) -> dict[Hand, Arm]:
    """Return the arm of each hand of the scenario: the identified one, else its usual follower."""
    return {hand: found.get(hand, FOLLOWER[hand]) for hand in scenario.source.hands}
