"""The summary of a run from its logs, judged: its problems, and the verdict on each set of requirements."""

from collections.abc import Sequence
from typing import Any

from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.subjects.measured_values import measured_values
from tis.deploy.report.subjects.requirements import verdicts
from tis.deploy.report.subjects.ticks import active_duration_s
from tis.deploy.report.summary import Summary, measured
from tis.deploy.report.validity import invalidities
from tis.patient_side.statespace import ArmModel


def build_summary(
    logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel], mode: str, exit_code: int | None, command: str
) -> dict[str, Any]:
    """Return the content of ``summary.json``."""
    return summary_of(MeasuredRun.of(logs, scenario, models), mode, exit_code, command).as_json()


def summary_of(run: MeasuredRun, mode: str, exit_code: int | None, command: str) -> Summary:
    """Return the summary of a run from its logs; a figure that cannot be computed is None.

    ``problems`` lists what makes the run invalid as a measurement; ``valid`` is true without any.
    """
    found = measured(run, mode, exit_code, command)
    problems = found.problems + invalidities(found, run.scenario, run.logs)
    tracks, samples_lost = list(run.tracks.values()), found.redundancy.loss_text
    values = measured_values(run.logs, run.scenario, run.used, run.latency, run.durations_ns, tracks, samples_lost)
    judged = verdicts(values, run.scenario.limits, _over_s(run.logs, run.scenario))
    return found.model_copy(update={"verdicts": judged, "problems": problems, "valid": not problems})


def _over_s(logs: RunLogs, scenario: Scenario) -> float | None:
    """Return the duration of the measurement; None when a log is damaged."""
    lacking = (log for log in logs.sides.values() if not log.coverage.whole)
    return None if any(lacking) else active_duration_s(logs, "surgeon", scenario)
