"""Model files: the models of one or two arms as JSON, every number exact, and the weights of learned ones.

The declared fields of `ArmModel` and its parts are the schema. A file with weights is a file of safetensors, whose
metadata holds the JSON text. Nothing in it is code (no pickle). The text names every array of weights by the tensor
that holds it, so that two hands that share a learned model store it once.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Final, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails
from safetensors import SafetensorError
from safetensors import numpy as tensors_of_numpy

from tis.common.errors import DataError, Fault
from tis.patient_side.learned_model import LearnedModel, Singles, Weights
from tis.patient_side.model_fields import StoredModel
from tis.patient_side.statespace import ArmModel

MAX_MODEL_BYTES: Final = 32_000_000
"""Size of a model file, several times that of one with every learned method."""
MAX_TEXT: Final = 4_000_000
"""Characters of its text, a hundred times those of the usual one."""

Tensors = Mapping[str, NDArray[np.float32]]

_TEXT: Final = "tis"
"""Key of the models' text in the file's metadata."""
_METADATA: Final = "__metadata__"
_LENGTH_BYTES: Final = 8
_MAX_FAULTS: Final = 50
_RULES: Final = {
    "unexpected_keyword_argument": "Extra inputs are not permitted",
    "dataclass_type": "must be a valid dictionary",
    "list_type": "must be a valid list",
    "tuple_type": "must be a valid list",
}
"""Rules by the type of the fault, in the words of files and not of Python."""


@dataclass(frozen=True)
class _File(StoredModel):
    """The text of a whole file."""

    version: Literal[1]
    models: Annotated[list[ArmModel], Field(min_length=1, max_length=2)]

    def faults(self) -> Sequence[str]:
        hands = [model.hand for model in self.models]
        return [f"models must be of different hands, not twice {hands[0]}"] if len(set(hands)) < len(hands) else []


@cache
def _adapter() -> TypeAdapter[_File]:
    return TypeAdapter(_File)


def dump_models(models: Sequence[ArmModel]) -> bytes:
    """Return the file of one or two models; `parse_models` restores every number bit for bit.

    It is JSON; with learned models safetensors, whose metadata holds that JSON.
    """
    tensors: dict[str, Singles] = {}
    text = _adapter().dump_json(_File(1, [_with_names(model, tensors) for model in models]))
    _adapter().validate_json(text)
    text += b"\n"
    return dump_tensors(text.decode(), tensors) if tensors else text


def parse_models(data: bytes, where: str) -> tuple[ArmModel, ...]:
    """Return the models of a file; raises `DataError` with every fault; ``where`` names the file."""
    tensors: Tensors = {}
    if is_tensor_file(data):
        text, tensors = parse_tensors(data, where)
    else:
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            raise DataError(Fault(where, "", "model file cannot be read: not UTF-8 text")) from None
    if len(text) > MAX_TEXT:
        raise DataError(Fault(where, "", f"must have at most {MAX_TEXT} characters", len(text)))
    try:
        json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(Fault(where, "", f"must be JSON: {error}")) from None
    try:
        file = _adapter().validate_json(text)
    except ValidationError as error:
        n_faults = error.error_count()
        shown = [_fault(detail, where) for detail in error.errors()[:_MAX_FAULTS]]
        if n_faults > _MAX_FAULTS:
            shown.append(Fault(where, "", f"and {n_faults - _MAX_FAULTS} more faults"))
        raise DataError(shown) from None
    return tuple(
        replace(_without_former(model), learned=tuple(_with_weights(each, tensors, where) for each in model.learned))
        for model in file.models
    )


def _without_former(model: ArmModel) -> ArmModel:
    """Return a model without what only earlier versions compute, and a warning that says so."""
    innovations = model.innovations
    if innovations is None or innovations.correction is None or not innovations.correction.has_former_heads:
        return model
    innovations = replace(innovations, correction=replace(innovations.correction, heads=[]))
    warning = (
        f"the model of the {model.hand} hand has heads of an earlier version, which are not used: train it again, "
        "with tis identify, to have its best forecasts"
    )
    return replace(model, innovations=innovations, warnings=(*model.warnings, warning))


def _with_names(model: ArmModel, tensors: dict[str, Singles]) -> ArmModel:
    """Return a model that names its weights, which are added to ``tensors``, those of an earlier hand once."""
    parts = []
    for learned in model.learned:
        names = {}
        for name, weight in learned.weights.items():
            shared = f"{learned.method}.{name}"
            if shared in tensors and not np.array_equal(tensors[shared], weight):
                shared = f"{model.hand}.{shared}"
            tensors[shared] = weight
            names[name] = shared
        parts.append(replace(learned, weights=cast("Weights", names)))
    return replace(model, learned=tuple(parts))


def _with_weights(learned: LearnedModel, tensors: Tensors, where: str) -> LearnedModel:
    """Return a learned model with the weights that it names."""
    names = cast("Mapping[str, str]", learned.weights)
    missing = [name for name in names.values() if name not in tensors]
    if missing:
        raise DataError([Fault(where, name, f"is missing, and {learned.method} needs it") for name in missing])
    return replace(learned, weights={name: tensors[stored] for name, stored in names.items()})


def _fault(detail: ErrorDetails, where: str) -> Fault:
    field, given = ".".join(str(step) for step in detail["loc"]), detail["input"]
    rule = detail["msg"].removeprefix("Value error, ").removeprefix("Input ").replace("should", "must")
    rule = _RULES.get(detail["type"], rule)
    return Fault(where, field, rule) if isinstance(given, dict | StoredModel) else Fault(where, field, rule, given)


def is_tensor_file(data: bytes) -> bool:
    """Tell whether a model file's content is not the JSON text of a file without weights."""
    return not data[:64].lstrip().startswith(b"{")


def dump_tensors(text: str, tensors: Tensors) -> bytes:
    """Return the file of a text and its tensors."""
    return bytes(
        tensors_of_numpy.save({name: np.ascontiguousarray(each) for name, each in tensors.items()}, {_TEXT: text})
    )


def parse_tensors(data: bytes, where: str) -> tuple[str, Tensors]:
    """Return text and tensors of a file; raises `DataError` for one that is truncated, or not of tis."""
    try:
        tensors = tensors_of_numpy.load(data)
    except SafetensorError as error:
        rule = f"must be JSON or safetensors, and whole: {error}"
        raise DataError(Fault(where, "", rule)) from None
    # The library has checked the header, but returns its metadata for files on disk only.
    n_bytes = int.from_bytes(data[:_LENGTH_BYTES], "little")
    header = json.loads(data[_LENGTH_BYTES : _LENGTH_BYTES + n_bytes])
    text = header.get(_METADATA, {}).get(_TEXT)
    if text is None:
        raise DataError(Fault(where, f"{_METADATA}.{_TEXT}", "is missing: `tis identify` did not write this file"))
    wrong = {name: str(each.dtype) for name, each in tensors.items() if each.dtype != np.float32}
    if wrong:
        raise DataError([Fault(where, name, "must be float32", found) for name, found in wrong.items()])
    return text, tensors
