"""The surgeon's node from a scenario and a recording."""

from common.scenario import Scenario
from common.sources.trajectory import Recording
from common.ticker import Ticker
from common.units import ms_to_ns
from surgeon_side.node import Redundancy, SurgeonNode


def build_surgeon(scenario: Scenario, recording: Recording) -> SurgeonNode:
    """Return a surgeon that plays the recording's rows from its start, at the scenario's rate."""
    part = scenario.surgeon
    redundancy = Redundancy(part.copies, ms_to_ns(part.copy_spacing_ms), part.history)
    return SurgeonNode(scenario.session, recording, Ticker(scenario.rate_hz, scenario.n_samples), redundancy)
