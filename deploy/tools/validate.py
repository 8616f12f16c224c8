"""Check of `tis validate` beyond the scenario's own text: its network can be built."""

from common.runtime.trace_files import load_traces
from common.scenario import Scenario
from netem.build import build_netem


def check_network(scenario: Scenario, where: str) -> None:
    """Read the traces that a scenario names and build its links, as a run would.

    Raises `DataError` with the faults of all traces (missing, unsorted, a delay below 0), `InputError` with those of
    the rules (two that tie).
    """
    build_netem(scenario, load_traces(scenario.network), where)
