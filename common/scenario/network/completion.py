"""Completion of stages that are given in part: their kind, and the parameters that stay as they were."""

from collections.abc import Mapping
from typing import Any, Final, get_args

from pydantic import BaseModel, ValidationError

from tis.common.errors import Fault, InputError
from tis.common.scenario.network.delay import Delay, Jitter
from tis.common.scenario.network.loss import Loss

KINDS: Final[Mapping[str, Any]] = {"loss": Loss, "delay": Delay, "jitter": Jitter}
"""The stages that come in kinds."""


def models_of(stage: str) -> dict[str, type[BaseModel]]:
    """Return the models of a stage that comes in kinds, by their kind."""
    union = get_args(KINDS[stage])[0]
    return {get_args(model.model_fields["kind"].annotation)[0]: model for model in get_args(union)}


def complete_stage(stage: str, given: Mapping[str, Any], current: Any, where: str) -> Mapping[str, Any]:
    """Return a whole stage, completed from the ``given`` part and the ``current`` stage.

    The current kind is kept if it has all given parameters, else the first kind that is then complete is taken.
    Raises `InputError` when no kind has all of them.
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
        missing = f"no kind has {' and '.join(strange or given)}" + ("" if strange else " together")
        raise InputError(Fault(where, stage, f"must be kind: {'|'.join(models)}; {missing} (see `tis net stages`)"))
    return next((raw for raw, model in candidates if _is_valid(raw, model)), candidates[0][0])


def _fitting(raw: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    return {name: value for name, value in raw.items() if name in model.model_fields}


def _is_valid(raw: Mapping[str, Any], model: type[BaseModel]) -> bool:
    try:
        model.model_validate(raw)
    except ValidationError:
        return False
    return True
