"""Reading and planning of studies, with faults under the names of a study's own fields."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.scenario_files import read_scenario
from tis.deploy.compare.choices import COMMAND
from tis.deploy.compare.plan import Plan, make_plan
from tis.deploy.compare.study import IN_PYTHON, Study
from tis.deploy.run.resolve import is_file, scenario_path

_FIELDS: Final = {
    "--set": "settings",
    "--sweep": "axes",
    "--zip": "zip",
    "--seeds": "seeds",
    "--seed": "seed",
    "--duration-s": "duration_s",
    "--estimators": "estimators",
    "--trials": "trials",
    "--people": "people",
}
"""The field of a study for each option of `tis compare` of the same meaning."""
_OVERRIDING: Final = {"n_seeds": "--seeds", "duration_s": "--duration-s"}
_OPTION: Final = re.compile("|".join(sorted(_FIELDS, key=len, reverse=True)))


def read_study(file: Path) -> tuple[Study, str]:
    """Return the study of a YAML file and its name in faults; raises `InputError` with all faults of the file.

    A scenario that lies beside the file is taken from there.
    """
    where = str(file)
    study = Study.model_validate(read_scenario(file), context={"where": where})
    beside = file.parent / study.scenario
    return (study.model_copy(update={"scenario": str(beside)}) if is_file(beside) else study), where


def plan_study(study: Study, where: str = IN_PYTHON, overrides: Mapping[str, Any] | None = None) -> Plan:
    """Return the plan of a study, with fields of its `Request` replaced by ``overrides``.

    Raises `InputError` and `DataError` with all faults: of the study under ``where`` and its fields, of ``overrides``
    under their options.
    """
    given = dict(overrides or {})
    if "trials" in given or "people" in given:  # one of them selects the trials
        given = {"trials": None, "people": None} | given
    _check_scenario(study, where)
    kept = {_OVERRIDING.get(name, f"--{name}") for name in given}
    try:
        return make_plan(replace(study.request, **given))
    except InputError as error:
        raise InputError([_of_study(fault, where, kept) for fault in error.faults]) from None
    except DataError as error:
        raise DataError([_of_study(fault, where, kept) for fault in error.faults]) from None


def _check_scenario(study: Study, where: str) -> None:
    """Raise `InputError` where there is no such scenario."""
    try:
        scenario_path(study.scenario)
    except InputError as error:
        raise InputError([Fault(where, "scenario", one.rule, study.scenario) for one in error.faults]) from None


def _of_study(fault: Fault, where: str, kept: set[str]) -> Fault:
    """Return a fault of an option as one of the study's field, unless the option itself was given."""
    options = [fault.field] if fault.where == COMMAND else fault.where.split(" and ")
    if not all(option in _FIELDS for option in options) or kept.intersection(options):
        return fault
    fields = " and ".join(_FIELDS[option] for option in options)
    path = "" if fault.where == COMMAND else fault.field
    rule = _OPTION.sub(lambda found: _FIELDS[found[0]], fault.rule)
    return replace(fault, where=where, field=f"{fields}.{path}" if path else fields, rule=rule)
