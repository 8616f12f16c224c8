"""The view of a run that all its reports share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tis.common.channels import FOLLOWER, Arm, Hand
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.plots.hand_view import HandView, hand_view
from tis.patient_side.statespace import ArmModel


@dataclass(frozen=True)
class RunView:
    """The logs, the summary and the scenario of a run, and the arm of each hand."""

    logs: RunLogs
    scenario: Scenario
    summary: dict[str, Any]
    arms: dict[Hand, Arm]
    versions: dict[str, str | None]
    models: Sequence[ArmModel] = field(default=())

    @property
    def synthetic(self) -> bool:
        """Return whether the movement is synthetic, not recorded from a person."""
        return self.scenario.source.synthetic

    @property
    def mark(self) -> str:
        """Return the mark beside the title of each section that shows the movement."""
        return "synthetic" if self.synthetic else ""

    def hands(self) -> list[HandView]:
        """Return the view of each hand."""
        origin = ", synthetic" if self.synthetic else ""
        return [hand_view(self.logs, self.scenario, h, f"{h} hand ({arm}{origin})") for h, arm in self.arms.items()]


def arms_of(scenario: Scenario, found: dict[Hand, Arm]) -> dict[Hand, Arm]:
    """Return the arm of each hand of the scenario: the identified one, else its usual follower."""
    return {hand: found.get(hand, FOLLOWER[hand]) for hand in scenario.source.hands}


def run_view(
    logs: RunLogs,
    scenario: Scenario,
    models: Sequence[ArmModel],
    summary: dict[str, Any],
    manifest: Mapping[str, Any],
) -> RunView:
    """Return the view of a run, with the versions in its manifest."""
    arms = arms_of(scenario, {model.hand: model.arm for model in models})
    found = manifest.get("versions")
    versions = {"python": manifest.get("python"), **found} if isinstance(found, dict) else {}
    return RunView(logs, scenario, summary, arms, versions, models)
