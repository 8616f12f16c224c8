"""Mode, scenario, models and user code of a run, from its logs."""

from collections.abc import Mapping

from tis.common.errors import DataError, Fault
from tis.common.runtime.log_parts import part_clock
from tis.common.runtime.user_code import USER_CODE_FILE, Origin, parse_origins
from tis.common.sources.provenance import MODEL_FILES
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.shell import run_dir as folder
from tis.patient_side.identification.model_file import parse_models
from tis.patient_side.statespace import ArmModel


def scenario_in(logs: RunLogs) -> str | None:
    """Return the scenario (YAML) in the logs, None without any; raises `DataError` when they or their runs differ."""
    run_id_in(logs)
    texts = {
        log.attachments[folder.SCENARIO_FILE]
        for log in logs.sides.values()
        if folder.SCENARIO_FILE in log.attachments
    }
    if len({log.metadata["digest"] for log in logs.sides.values() if "digest" in log.metadata}) > 1:
        raise DataError(Fault(str(logs.run_dir), "", "holds logs of different scenarios"))
    return _decoded(logs, next(iter(texts)), folder.SCENARIO_FILE) if texts else None


def _decoded(logs: RunLogs, data: bytes, name: str) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise DataError(Fault(str(logs.run_dir), name, "must be UTF-8 text")) from None


def run_id_in(logs: RunLogs) -> int | None:
    """Return the number of the run that the logs are of, None for a twin; raises `DataError` when they differ."""
    clocks = (part_clock(log.attachments) for log in logs.sides.values())
    found = {clock.run_id for clock in clocks if clock is not None and clock.run_id is not None}
    if len(found) > 1:
        raise DataError(Fault(str(logs.run_dir), "", "holds logs of different runs"))
    return next(iter(found), None)


def mode_of(logs: RunLogs) -> str:
    """Return the mode of the run, live or twin."""
    return next((log.metadata["mode"] for log in logs.sides.values() if "mode" in log.metadata), "live")


def models_in(logs: RunLogs) -> tuple[ArmModel, ...]:
    """Return the models in the patient's log; raises `DataError` when they cannot be read."""
    log = logs.sides.get("patient")
    attached: Mapping[str, bytes] = {} if log is None else log.attachments
    found = [attached[name] for name in MODEL_FILES if name in attached]
    return parse_models(found[0], "patient.mcap") if found else ()


def origins_in(logs: RunLogs) -> dict[str, Origin]:
    """Return the origins of user-defined estimators in the patient's log; raises `DataError` when damaged."""
    data = logs.attachments("patient").get(USER_CODE_FILE)
    return {} if data is None else parse_origins(data, "patient.mcap")
