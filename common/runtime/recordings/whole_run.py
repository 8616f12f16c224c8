"""Resolution of ``duration_s: auto``: a run that plays all of its recording.

It is resolved once, where the scenario is read. Sides, logs and digests then know a number only, on which all sides
must agree.
"""

from collections.abc import Mapping
from typing import Any, Final

from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.recordings import own_trial, trial_file, whole_recording
from tis.common.scenario import AUTO, Scenario, reading
from tis.common.scenario.source import RecordedSource

_FOR_CHECKS: Final = 1.0


def plays_all(raw: Mapping[str, Any]) -> bool:
    """Tell whether a raw scenario's duration is that of its recording."""
    return raw.get("duration_s") == AUTO


def without_auto(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return a raw scenario with a number as duration, so that all its other fields can be checked."""
    return {**raw, "duration_s": _FOR_CHECKS} if plays_all(raw) else dict(raw)


def whole_run(scenario: Scenario, where: str) -> Scenario:
    """Return the scenario with the duration of all its recording, from the first row on.

    Raises `InputError` for a source without an end or where no row is left to play, `DataError` for a recording that
    cannot be read. Oracle: recordings of known length in the tests.
    """
    source = scenario.source
    if not isinstance(source, RecordedSource):
        rule = f"must be a number of seconds: auto plays all of a recording, and a {source.kind} movement has no end"
        raise InputError(Fault(where, "duration_s", rule, AUTO))
    start = scenario.first_row()
    try:
        recording = whole_recording(scenario, source, start)
    except DataError as error:
        if trial_file(source, own_trial(source)).exists():
            raise
        rule = (
            "auto needs the recording on this host; else set the number of seconds, which `tis validate SCENARIO` "
            "prints on a host that has it"
        )
        raise DataError([*error.faults, Fault(where, "duration_s", rule)]) from None
    longest = len(recording) - start - 1
    if longest < 1:
        rows = f"{recording.file} has {len(recording)} rows, and the run begins at row {start}"
        rule = f"auto finds no row to play: {rows}"
        raise InputError(Fault(f"scenario {scenario.name}", "duration_s", rule))
    raw = scenario.model_dump(mode="json", exclude_none=True)
    return reading.build_scenario({**raw, "duration_s": longest / scenario.rate_hz}, where)


def build_whole(raw: Mapping[str, Any], where: str, profiles: reading.Profiles | None = None) -> Scenario:
    """Return what `build_scenario` returns, also for a raw scenario whose duration is auto; raises as `whole_run`."""
    scenario = reading.build_scenario(without_auto(raw), where, profiles)
    return whole_run(scenario, where) if plays_all(raw) else scenario
