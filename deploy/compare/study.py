"""Reading and planning of studies, with faults under the names of a study's own fields."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import yaml
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    JsonValue,
    ModelWrapValidatorHandler,
    StrictBool,
    StrictFloat,
    StrictInt,
    StringConstraints,
    Tag,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.scenario_files import lines_told, read_scenario
from tis.common.scenario.base import Part, Positive, RuleText
from tis.common.scenario.faults import faults
from tis.deploy.compare.grid import COMMAND, MAX_VALUES, Sweep, number_text, spanned
from tis.deploy.compare.plan import MAX_SEEDS, Plan, Request, make_plan
from tis.deploy.run.resolve import is_file, scenario_path

# A study: what is compared, as one value. A YAML file and a program in Python describe the same one.

IN_PYTHON: Final = "Study"
"""Place of the faults of a study that no file holds."""
_LARGEST: Final = 1e15  # beyond it floats are no longer exact integers, and ranges overflow

FieldPath = Annotated[
    str,
    StringConstraints(pattern=r"^[^\s.=,]+(\.[^\s.=,]+)*$", max_length=200),
    RuleText("must be the path of a field, like network.forward.delay.delay_ms"),
]
_Text = Annotated[str, StringConstraints(strict=True, pattern=r"^[^\n]+$", max_length=200)]
Value = Annotated[
    StrictBool | StrictInt | StrictFloat | _Text,
    RuleText("must be a number, a name such as a profile's, or true or false"),
]
_Bool = Annotated[StrictBool, RuleText("must be true or false")]
_Setting = Annotated[JsonValue, RuleText("must be text, a number, true, false, null, a list or a mapping")]
_Name = Annotated[str, StringConstraints(min_length=1, max_length=200)]
_Names = Annotated[tuple[_Name, ...], Field(min_length=1, max_length=MAX_VALUES)]


class Range(Part):
    """Values from ``first`` to ``last``."""

    first: float = Field(ge=-_LARGEST, le=_LARGEST, description="First value.")
    last: float = Field(ge=-_LARGEST, le=_LARGEST, description="Last value.")
    count: int = Field(strict=True, ge=2, le=MAX_VALUES, description="Number of values.")
    spacing: Literal["linear", "log"] = Field("linear", description="linear: equal steps; log: equal ratios.")

    @model_validator(mode="after")
    def _positive(self) -> Self:
        if self.spacing == "log" and (self.first <= 0 or self.last <= 0):
            raise ValueError("spacing: log needs numbers above 0")
        return self


def _plain(value: Any) -> Any:
    """Return arrays and numbers of numpy as Python's."""
    value = value.tolist() if hasattr(value, "tolist") else value
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _list_or_range(value: object) -> str | None:
    return "list" if isinstance(value, list | tuple) else "Range" if isinstance(value, dict | Range) else None


Axis = Annotated[
    Annotated[tuple[Value, ...], Field(min_length=1, max_length=MAX_VALUES), Tag("list")]
    | Annotated[Range, Tag("Range")],
    Discriminator(
        _list_or_range,
        custom_error_type="in_words",
        custom_error_message="must be a list of values, or {first: NUMBER, last: NUMBER, count: N}",
    ),
    BeforeValidator(_plain),
]


class Study(Part):
    """A comparison of estimators on the same arrivals: every combination of the values of ``axes``.

    The fields are those of a study file. Raises `InputError` with all its faults. Oracle: the same study as options
    of `tis compare`, tests/deploy/compare/test_study.
    """

    scenario: str = Field(
        min_length=1,
        max_length=4096,
        description="The scenario: a file, in a study file relative to it, or the name of a shipped one.",
    )
    settings: dict[FieldPath, _Setting] = Field(
        {}, description="Values of the scenario's fields by their paths, as --set; null removes an optional one."
    )
    axes: dict[FieldPath, Axis] = Field(
        {},
        description="Fields that vary, by their paths, each with a list of values or a range. The settings compared "
        "are all combinations.",
    )
    zip: _Bool = Field(False, description="Whether the values of the axes are taken side by side instead.")
    seeds: int | None = Field(
        None,
        strict=True,
        ge=1,
        le=MAX_SEEDS,
        description="Seeds of each trial, by default 1; of a synthetic source, by default 5.",
    )
    seed: int | None = Field(None, strict=True, ge=0, description="The first seed, by default the scenario's.")
    duration_s: Positive | None = Field(
        None, le=86_400, description="Longest part of each trial that is used, in s; by default all of it."
    )
    estimators: _Names | None = Field(
        None, description="Estimators: names, or module:factory; by default the scenario's."
    )
    trials: _Names | None = Field(
        None,
        description="Recorded trials; by default all in the folder, of a table itself unless train is others.",
    )
    people: _Names | None = Field(
        None, description="Letters of the people whose recorded trials are compared, instead of trials."
    )

    @model_validator(mode="wrap")
    @classmethod
    def _in_our_words(cls, raw: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        where = (info.context or {}).get("where", IN_PYTHON)
        try:
            study = handler(raw)
        except ValidationError as error:
            raise InputError(faults(error, cls, where)) from None
        if found := study._contradictions(where):
            raise InputError(found)
        return study

    def _contradictions(self, where: str) -> list[Fault]:
        repeated = [sweep.path for sweep in self.sweeps if len(set(sweep.values)) < len(sweep.values)]
        found = [Fault(where, f"axes.{path}", "values must be different") for path in repeated]
        if self.trials is not None and self.people is not None:
            found.append(Fault(where, "people", "must be given without trials"))
        return found

    @property
    def sweeps(self) -> tuple[Sweep, ...]:
        """The axes, each with its values as text."""
        return tuple(Sweep(path, _texts(axis)) for path, axis in self.axes.items())

    @property
    def request(self) -> Request:
        """The same as a request to `tis compare`."""
        return Request(
            scenario=self.scenario,
            settings=tuple(f"{path}={_yaml(value)}" for path, value in self.settings.items()),
            estimators=self.estimators,
            trials=self.trials,
            people=self.people,
            n_seeds=self.seeds,
            seed=self.seed,
            duration_s=self.duration_s,
            sweeps=self.sweeps,
            zipped=self.zip,
        )


def _texts(axis: tuple[Value, ...] | Range) -> tuple[str, ...]:
    if isinstance(axis, Range):
        return tuple(spanned(axis.first, axis.last, axis.count, axis.spacing == "log"))
    return tuple(number_text(value) if isinstance(value, float) else _yaml(value) for value in axis)


def _yaml(value: Any) -> str:
    """Return a value as YAML on one line."""
    text = yaml.safe_dump(value, default_flow_style=True, width=float("inf"), sort_keys=False, allow_unicode=True)
    return str(text).removesuffix("...\n").strip()


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
    with lines_told(file):
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
