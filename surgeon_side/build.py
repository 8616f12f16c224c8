"""The surgeon's node from a scenario and a recording."""

from common.scenario import Scenario
from common.sources.trajectory import Recording
from common.ticker import Ticker
from surgeon_side.node import SurgeonNode


def build_surgeon(scenario: Scenario, recording: Recording) -> SurgeonNode:
    """Return a surgeon that plays the recording's rows from its start, at the scenario's rate."""
    return SurgeonNode(scenario.session, recording, Ticker(scenario.rate_hz, scenario.n_samples))
