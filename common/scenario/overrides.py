"""Overrides ``a.b=VALUE`` of a scenario file by options, and the attribution of faults to options.

A stage of the network that is given in part is completed: by its kind, and by the parameters that stay as they were.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any, Final, NamedTuple, get_args

from pydantic import BaseModel, ValidationError

from tis.common.channels import Direction
from tis.common.errors import Fault, InputError
from tis.common.scenario.faults import meant
from tis.common.scenario.network.delay import Delay, Jitter
from tis.common.scenario.network.loss import Loss
from tis.common.scenario.reading import apply_settings

KINDS: Final[Mapping[str, Any]] = {"loss": Loss, "delay": Delay, "jitter": Jitter}
"""The stages that come in kinds."""


def models_of(stage: str) -> dict[str, type[BaseModel]]:
    """Return the models of a stage that comes in kinds, by their kind."""
    union = get_args(KINDS[stage])[0]
    return {get_args(model.model_fields["kind"].annotation)[0]: model for model in get_args(union)}


def complete_stage(stage: str, given: Mapping[str, Any], current: Any, where: str) -> Mapping[str, Any]:
    """Return a whole stage, completed from the ``given`` part and the ``current`` stage.

    The current kind is kept if it has all given parameters, even where it refuses their values: another one would
    drop what else was set. Else the first kind that is then complete is taken. Raises `InputError` when no kind has
    all of them.
    """
    beneath: Mapping[str, Any] = current if isinstance(current, Mapping) else {}
    if "kind" in given:
        return given
    # Every kind that has all given parameters, the current kind first; parameters that it shares are kept.
    models = models_of(stage)
    candidates = [
        ({**_fitting(beneath, model), **given, "kind": kind}, model)
        for kind, model in sorted(models.items(), key=lambda one: one[0] != beneath.get("kind"))
        if given.keys() <= model.model_fields.keys()
    ]
    if not candidates:
        known = {name for model in models.values() for name in model.model_fields}
        strange = [name for name in given if name not in known]
        missing = f"no kind has {' and '.join(strange or given)}"
        missing += "".join(meant(name, sorted(known)) for name in strange) if strange else " together"
        raise InputError(Fault(where, stage, f"must be kind: {'|'.join(models)}; {missing} (see `tis net stages`)"))
    if candidates[0][0]["kind"] == beneath.get("kind"):
        return candidates[0][0]
    return next((raw for raw, model in candidates if _is_valid(raw, model)), candidates[0][0])


def _fitting(raw: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    return {name: value for name, value in raw.items() if name in model.model_fields}


def _is_valid(raw: Mapping[str, Any], model: type[BaseModel]) -> bool:
    try:
        model.model_validate(raw)
    except ValidationError:
        return False
    return True


_REMOVE: Final = ("", "~", "null")


def apply_network_settings(
    raw: Mapping[str, Any], settings: Sequence[str], where: str, below: Sequence[str]
) -> dict[str, Any]:
    """Return ``raw`` with each ``a.b=VALUE`` applied, as by `tis.common.scenario.reading.apply_settings`.

    A setting of a direction's stage, like ``forward.loss.p_loss=0.1``, may omit the kind, which `complete_stage`
    finds. ``below`` is the path of the network in ``raw``. Raises `InputError`.
    """
    # Settings of stages are collected first: the kind of a stage depends on all parameters given for it.
    parts = [setting for setting in settings if _is_part(setting, below)]
    result = apply_settings(raw, [setting for setting in settings if setting not in parts])
    given_stages, network = _network(apply_settings({}, parts), below), _network(result, below)
    for direction, stages in given_stages.items():
        pipeline = network.get(direction)
        present = pipeline if isinstance(pipeline, Mapping) else {}
        for stage, given in stages.items():
            current = present.get(stage)
            # With a kind, or over something that is no stage, the settings apply as they are.
            if "kind" in given or not isinstance(current, Mapping | None):
                mine = [one for one in parts if one.startswith(".".join((*below, direction, stage, "")))]
                result = apply_settings(result, mine)
                continue
            whole = complete_stage(stage, given, current, f"{where}: {direction}")
            result = _replaced(result, (*below, direction, stage), whole)
    return result


def _is_part(setting: str, below: Sequence[str]) -> bool:
    path, _, text = setting.partition("=")
    steps = path.split(".")
    inner = steps[len(below) :]
    is_stage = len(inner) == 3 and inner[0] in get_args(Direction) and inner[1] in KINDS and inner[2] != ""
    return steps[: len(below)] == list(below) and is_stage and text.strip() not in _REMOVE


def _network(raw: Mapping[str, Any], below: Sequence[str]) -> Mapping[str, Any]:
    here: Any = raw
    for step in below:
        here = here.get(step) if isinstance(here, Mapping) else None
    return here if isinstance(here, Mapping) else {}


def _replaced(raw: Mapping[str, Any], path: Sequence[str], value: Any) -> dict[str, Any]:
    first, *rest = path
    below = raw.get(first)
    return {**raw, first: _replaced(below if isinstance(below, Mapping) else {}, rest, value) if rest else value}


_OF_ONE_FIELD: Final = ("--seed", "--duration-s", "--unmatched")


class Override(NamedTuple):
    """A setting, ``a.b=VALUE``, and the option that gave it."""

    option: str
    setting: str

    @property
    def path(self) -> str:
        """Return the field that the setting changes."""
        return self.setting.partition("=")[0]


def apply_overrides(
    raw: Mapping[str, Any], overrides: Sequence[Override], below: Sequence[str]
) -> tuple[dict[str, Any], list[Fault]]:
    """Return ``raw`` with all applicable overrides applied, and the faults of the others.

    ``below`` is the path of the network in ``raw``, as in `tis.common.scenario.overrides`.
    """
    faults: list[Fault] = []
    good: list[str] = []
    try:
        return apply_network_settings(raw, [one.setting for one in overrides], "--set", below), faults
    except InputError:
        pass  # the faulty ones are found one by one
    for one in overrides:
        try:
            apply_network_settings(raw, [*good, one.setting], "--set", below)
            good.append(one.setting)
        except InputError as error:
            faults += [replace(fault, where=fault.where.replace("--set", one.option, 1)) for fault in error.faults]
    return apply_network_settings(raw, good, "--set", below), faults


def blamed(faults: Sequence[Fault], where: str, own: Sequence[Fault], overrides: Sequence[Override]) -> list[Fault]:
    """Return the faults of the file ``where`` with overrides, each attributed to the file or to an option.

    Faults that occur without overrides too (``own``) are the file's. Any other is attributed to the overrides whose
    path shares most steps with the fault's; if the fault's rule names some of these, to those. Oracle: faults of
    known origin, tests/deploy/run/test_resolve_faults.
    """
    known = {(fault.field, fault.rule) for fault in own}
    return [
        _blamed_on(fault, overrides) if fault.where == where and (fault.field, fault.rule) not in known else fault
        for fault in faults
    ]


def _blamed_on(fault: Fault, overrides: Sequence[Override]) -> Fault:
    # Candidates: the overrides nearest to the fault's path, or of these the ones that its rule mentions.
    shared = [_shared(fault.field, one.path) for one in overrides]
    near = [one for one, n in zip(overrides, shared, strict=True) if n == max(shared)]
    words = set(re.findall(r"\w+", fault.rule))
    near = [one for one in near if words.intersection(one.path.split("."))] or near
    around = [one for one in near if f"{fault.field}.".startswith(f"{one.path}.")]
    near = around[-1:] or near  # of several overrides of one path the last one applies
    where = " and ".join(dict.fromkeys(one.option for one in near))
    paths = ", ".join(dict.fromkeys(one.path for one in near))
    if around:
        return replace(fault, where=where, field="" if where in _OF_ONE_FIELD else fault.field)
    rule = f"{fault.field}: {fault.rule}" if fault.field else fault.rule
    return replace(fault, where=where, field="" if where in _OF_ONE_FIELD else paths, rule=rule)


def _shared(one: str, other: str) -> int:
    """Return how many steps two paths have in common from the top."""
    pairs = zip(one.split("."), other.split("."), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
