"""Model files: the models of one or two arms as JSON, every number exact, and the weights of learned ones."""

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from tis.common.errors import DataError, Fault
from tis.common.sources.provenance import RecordedRows
from tis.patient_side.direct_model import DirectModel
from tis.patient_side.identification.model_part import AXES, Matrix
from tis.patient_side.identification.model_schema import (
    CorrectionPart,
    FilterPart,
    InnovationsPart,
    LearnedPart,
    ModelFile,
    ModelPart,
    NoisePart,
    SpacePart,
)
from tis.patient_side.identification.model_tensors import Tensors, dump_tensors, is_tensor_file, parse_tensors
from tis.patient_side.identification.wrist_schema import DirectPart, RatePart, WristPart
from tis.patient_side.learned_model import LearnedModel, Singles, Training
from tis.patient_side.statespace import (
    ArmModel,
    Array,
    Correction,
    FilterModel,
    InnovationsModel,
    InputForecast,
    NoiseModel,
    StateSpace,
)
from tis.patient_side.wrist_model import RateModel, WristModel

MAX_MODEL_BYTES: Final = 32_000_000
"""Size of a model file, several times that of one with every learned method."""
MAX_TEXT: Final = 4_000_000
"""Characters of its text, a hundred times those of the usual one."""

_MAX_FAULTS: Final = 50


def dump_models(models: Sequence[ArmModel]) -> bytes:
    """Return the file of one or two models; `parse_models` restores every number bit for bit.

    It is JSON; with learned models safetensors, whose metadata holds that JSON.
    """
    tensors: dict[str, Singles] = {}
    plain = {"version": 1, "models": [_plain_model(model, tensors) for model in models]}
    text = ModelFile.model_validate(plain).model_dump_json() + "\n"
    return dump_tensors(text, tensors) if tensors else text.encode()


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
        raw = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(Fault(where, "", f"must be JSON: {error}")) from None
    try:
        file = ModelFile.model_validate(raw)
    except ValidationError as error:
        n_faults = error.error_count()
        shown = [_fault(detail, where) for detail in error.errors()[:_MAX_FAULTS]]
        if n_faults > _MAX_FAULTS:
            shown.append(Fault(where, "", f"and {n_faults - _MAX_FAULTS} more faults"))
        raise DataError(shown) from None
    return tuple(_arm_model(model, tensors, where) for model in file.models)


def _plain_model(model: ArmModel, tensors: dict[str, Singles]) -> dict[str, object]:
    """Return a model as plain values, and add its weights to ``tensors``, those of an earlier hand once."""
    plain = {key: _plain(value) for key, value in dataclasses.asdict(replace(model, learned=())).items()}
    parts = []
    for learned in model.learned:
        part = {key: _plain(value) for key, value in dataclasses.asdict(replace(learned, weights={})).items()}
        names = {}
        for name, weight in learned.weights.items():
            shared = f"{learned.method}.{name}"
            if shared in tensors and not np.array_equal(tensors[shared], weight):
                shared = f"{model.hand}.{shared}"
            tensors[shared] = weight
            names[name] = shared
        parts.append(part | {"weights": names})
    return plain | {"learned": parts}


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return list(value)
    return value


def _arm_model(model: ModelPart, tensors: Tensors, where: str) -> ArmModel:
    beside = ("innovations", "n4sid", "arx", "autoregression", "direct", "paper", "drmf", "learned", "wrist")
    rest = model.model_dump(exclude={"space", "noise", "forecast", "fit_pct", "warnings", "trained_on", *beside})
    vectors = {key: np.array(item, dtype=float) for key, item in rest.items() if isinstance(item, list)}
    forecast = model.forecast
    return ArmModel(
        **{**rest, **vectors},
        space=_space(model.space, model.order),
        noise=_noise(model.noise, model.order),
        forecast=InputForecast(
            forecast.damping, forecast.velocity_span, np.array(forecast.growth_m), forecast.persistence
        ),
        fit_pct=tuple(model.fit_pct),
        warnings=tuple(model.warnings),
        trained_on=tuple(RecordedRows(**rows.model_dump()) for rows in model.trained_on),
        innovations=_innovations(model.innovations),
        n4sid=_filter(model.n4sid),
        arx=_filter(model.arx),
        autoregression=_innovations(model.autoregression),
        direct=_direct(model.direct),
        paper=_filter(model.paper),
        drmf=None if model.drmf is None else model.drmf.model(),
        learned=tuple(_learned(part, tensors, where) for part in model.learned),
        wrist=_wrist(model.wrist),
    )


def _learned(part: LearnedPart, tensors: Tensors, where: str) -> LearnedModel:
    missing = [name for name in part.weights.values() if name not in tensors]
    if missing:
        raise DataError([Fault(where, name, f"is missing, and {part.method} needs it") for name in missing])
    about = part.training
    return LearnedModel(
        method=part.method,
        version=part.version,
        usual_m=part.usual_m,
        gripper_spread_rad=part.gripper_spread_rad,
        scale_ages=np.array(part.scale_ages, dtype=float),
        mean_share=np.array(part.mean_share, dtype=float),
        covariance_scale=np.array(part.covariance_scale, dtype=float),
        weights={name: tensors[stored] for name, stored in part.weights.items()},
        training=Training(
            about.seed, about.n_rows, tuple(about.held_out), about.n_epochs, np.array(about.errors, dtype=float)
        ),
    )


def _space(space: SpacePart, n: int) -> StateSpace:
    return StateSpace(
        _array(space.A, n, n), _array(space.B, n, AXES), _array(space.C, AXES, n), _array(space.D, AXES, AXES)
    )


def _noise(noise: NoisePart, n: int) -> NoiseModel:
    return NoiseModel(_array(noise.Q, n, n), _array(noise.R, AXES, AXES), _array(noise.S, n, AXES))


def _filter(part: FilterPart | None) -> FilterModel | None:
    if part is None:
        return None
    n = len(part.space.A)
    return FilterModel(
        _space(part.space, n),
        _noise(part.noise, n),
        np.array(part.input_offset_m, dtype=float),
        np.array(part.output_offset_m, dtype=float),
        part.static,
    )


def _innovations(part: InnovationsPart | None) -> InnovationsModel | None:
    if part is None:
        return None
    n = len(part.A)
    return InnovationsModel(
        A=_array(part.A, n, n),
        C=_array(part.C, AXES, n),
        K=_array(part.K, n, AXES),
        Re=_array(part.Re, AXES, AXES),
        level_step=part.level_step,
        block_rows=part.block_rows,
        singular_values=np.array(part.singular_values, dtype=float),
        scale_horizons=np.array(part.scale_horizons, dtype=float),
        covariance_scale=np.array(part.covariance_scale, dtype=float),
        integrated=part.integrated,
        isotropic=part.isotropic,
        correction=_correction(part.correction),
    )


def _correction(part: CorrectionPart | None) -> Correction | None:
    if part is None:
        return None
    values = part.model_dump()
    arrays = {key: np.array(each, dtype=float) for key, each in values.items() if isinstance(each, list)}
    return Correction(**{**values, **arrays})


def _direct(part: DirectPart | None) -> DirectModel | None:
    if part is None:
        return None
    return DirectModel(
        stride=part.stride,
        lags=np.array(part.lags, dtype=np.int64),
        horizons=np.array(part.horizons, dtype=np.int64),
        past=np.array(part.past, dtype=float),
        cross=np.array(part.cross, dtype=float),
        future=np.array(part.future, dtype=float),
        n_lags=np.array(part.n_lags, dtype=np.int64),
        penalty=np.array(part.penalty, dtype=float),
        covariance_scale=np.array(part.covariance_scale, dtype=float),
    )


def _wrist(part: WristPart | None) -> WristModel | None:
    if part is None:
        return None
    return WristModel(_rate(part.rate), _rate(part.gripper_rate), _direct(part.direct), _direct(part.gripper_direct))


def _rate(part: RatePart | None) -> RateModel | None:
    if part is None:
        return None
    horizons, covariance = np.array(part.horizons, dtype=float), np.array(part.covariance, dtype=float)
    return RateModel(part.stride, part.damping, part.velocity_span, horizons, covariance)


def _array(rows: Matrix, n_rows: int, n_columns: int) -> Array:
    """Return the matrix with its shape, which nested lists lose where a dimension is 0."""
    return np.array(rows, dtype=float).reshape(n_rows, n_columns)


def _fault(detail: ErrorDetails, where: str) -> Fault:
    field = ".".join(str(step) for step in detail["loc"])
    rule = detail["msg"].removeprefix("Value error, ").removeprefix("Input ").replace("should", "must")
    if isinstance(detail["input"], dict | BaseModel):
        return Fault(where, field, rule)
    return Fault(where, field, rule, detail["input"])
