"""A run, and the columns of its logs that several subjects share, each computed once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self, get_args

from tis.common.channels import Arm, Direction, Hand
from tis.common.metrics.latency import Instants, LatencyParts
from tis.common.scenario import Scenario
from tis.common.scenario.limits import Metric
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.subjects.age import ages_ns
from tis.deploy.report.subjects.latency import (
    UsedSamples,
    network_round_trips,
    round_trips,
    sample_latency,
    used_samples,
)
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.subjects.network.link_summary import link_summary
from tis.deploy.report.subjects.network.requested import Requested
from tis.deploy.report.subjects.orientation import WristTrack, wrist_track
from tis.deploy.report.subjects.pictures import Pictures
from tis.deploy.report.subjects.tracking import HandTrack, track_of_hand
from tis.patient_side.statespace import ArmModel


@dataclass(frozen=True)
class MeasuredRun:
    """The logs and the scenario of a run, the arm of each hand, and the identified models."""

    logs: RunLogs
    scenario: Scenario
    arms: dict[Hand, Arm]
    models: Sequence[ArmModel] = ()

    @classmethod
    def of(cls, logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel]) -> Self:
        """Return the run with the arms that its models are of."""
        return cls(logs, scenario, {model.hand: model.arm for model in models}, models)

    @cached_property
    def used(self) -> UsedSamples:
        """Return each sample at its first use."""
        return used_samples(self.logs, self.scenario.session, self.arms)

    @cached_property
    def latency(self) -> LatencyParts:
        """Return the latency of each used sample by part."""
        return sample_latency(self.used)

    @cached_property
    def round_trips_ns(self) -> Instants:
        """Return the round trip of each command that an estimate answers."""
        return round_trips(self.logs, self.scenario.session, self.arms)

    @cached_property
    def requests(self) -> dict[Direction, Requested]:
        """Return the requested network of each direction."""
        return {way: Requested.of(self.scenario, way, self.logs) for way in get_args(Direction)}

    @cached_property
    def tracks(self) -> dict[Hand, HandTrack]:
        """Return the track of each hand."""
        return {hand: track_of_hand(self.logs, self.scenario, hand) for hand in self.arms}

    @cached_property
    def wrists(self) -> dict[Hand, WristTrack]:
        """Return the errors of the orientation methods of each hand."""
        return {hand: wrist_track(self.logs, self.scenario, track, hand) for hand, track in self.tracks.items()}

    @cached_property
    def durations_ns(self) -> dict[Metric, Instants]:
        """Return the ages at the ticks, the round trips, and the network's part of them."""
        trips_ns = network_round_trips(self.used)
        found: dict[Metric, Instants] = {"age": ages_ns(self.logs), "round_trip": self.round_trips_ns}
        found["network_round_trip"] = trips_ns
        if self.pictures is not None:
            found["hand_to_eye"] = self.pictures.hand_to_eye_ns
        return found

    @cached_property
    def pictures(self) -> Pictures | None:
        """Return the frames of the camera and what the screen made of them; None without sight."""
        return Pictures.of(self.logs, self.scenario)

    @cached_property
    def links(self) -> dict[Direction, tuple[Link, list[str]]]:
        """Return the figures of each direction, with its problems."""
        return {way: link_summary(self.logs, way, self.scenario) for way in get_args(Direction)}
