"""The scenario that a run's logs hold, and whether they hold one and the same."""

from common.errors import DataError, Fault
from deploy import run_dir as folder
from deploy.report.read.load import RunLogs


def scenario_in(logs: RunLogs) -> str | None:
    """Return the scenario (YAML) that the logs hold, None when none does; raises `DataError` when they differ."""
    texts = {
        log.attachments[folder.SCENARIO_FILE]
        for log in logs.sides.values()
        if folder.SCENARIO_FILE in log.attachments
    }
    if len({log.metadata["digest"] for log in logs.sides.values() if "digest" in log.metadata}) > 1:
        raise DataError(Fault(str(logs.run_dir), "", "holds logs of different scenarios"))
    return next(iter(texts)).decode() if texts else None
