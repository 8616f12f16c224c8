"""Actual duration of a run, shorter than planned when it was cut short."""

from tis.common.channels import Side
from tis.common.records import TICKS
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs


def active_duration_s(logs: RunLogs, side: Side, scenario: Scenario) -> float:
    """Return how long a side ticked, in s; the planned duration where its log does not tell.

    Oracle: logs with a known number of ticks, tests/deploy/report/measures/test_duration.
    """
    ticks = logs.columns(side, TICKS).column("tick")
    n = int(ticks.max(initial=-1)) + 1
    return n / scenario.rate_hz if 0 < n < scenario.n_samples else scenario.duration_s
