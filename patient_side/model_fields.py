"""Fields of models as model files hold them: arrays as nested lists of finite numbers, with their shapes and rules.

A model is a plain dataclass: its annotations say what a file may hold, `StoredModel` what its arrays must look like
together. Only `tis.patient_side.identification.model_file` reads them; a model built in a program is not checked.
"""

from collections.abc import Callable, Iterable, Mapping
from operator import attrgetter
from typing import Annotated, Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ConfigDict, Field, GetPydanticSchema, model_validator
from pydantic_core import core_schema

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Shape = tuple[int, ...]

AXES: Final = 3

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Share = Annotated[Number, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]
Numbers = list[Number]
ThreeNumbers = Annotated[Numbers, Field(min_length=AXES, max_length=AXES)]


def _array(value: list[Any]) -> Floats:
    """Return nested lists as an array; where they are ragged, as one of arrays, whose shape fits nothing."""
    try:
        return np.array(value, dtype=np.float64)
    except ValueError:
        ragged = np.empty(len(value), dtype=object)
        ragged[:] = [_array(each) for each in value]
        return ragged


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def lists(stored: Any, into: Callable[[Any], Any] | None = None) -> GetPydanticSchema:
    """Return how a field is stored: as (nested) lists of the type ``stored``, read into an array or ``into``."""
    read = into or _array
    write = core_schema.plain_serializer_function_ser_schema(_plain)
    return GetPydanticSchema(
        lambda _, handler: core_schema.no_info_after_validator_function(read, handler(stored), serialization=write)
    )


def integers(values: list[int]) -> Integers:
    """Return whole numbers as an array."""
    return np.array(values, dtype=np.int64)


Vector = Annotated[Floats, lists(Numbers)]
Matrix = Annotated[Floats, lists(list[Numbers])]
Matrices = Annotated[Floats, lists(list[list[Numbers]])]
Axes = Annotated[Floats, lists(ThreeNumbers)]
Rising = Annotated[Floats, lists(Annotated[list[Positive], Field(min_length=1)])]
RisingCounts = Annotated[Integers, lists(Annotated[list[Count], Field(min_length=1)], integers)]


class StoredModel:
    """A model, or a part of one, in a model file: no key is unknown or missing, and arrays fit each other."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid")

    def shapes(self) -> Mapping[str, Shape]:
        """Return the shape of each array that depends on others, by (dotted) name of the field."""
        return {}

    def faults(self) -> Iterable[str]:
        """Yield what is wrong besides shapes."""
        return ()

    def covariances(self) -> Mapping[str, Floats]:
        """Return the arrays (3, 3) that must be covariances, by name."""
        return {}

    @model_validator(mode="after")
    def _sound(self) -> Self:
        check(self, self.shapes(), self.faults(), self.covariances())
        return self


def of_axes(axes: int) -> AfterValidator:
    """Return the check of a model whose field says of how many axes it is: by its ``check_axes``."""

    def checked(model: Any) -> Any:
        model.check_axes(axes)
        return model

    return AfterValidator(checked)


def check(
    model: object,
    shapes: Mapping[str, Shape],
    faults: Iterable[str],
    covariances: Mapping[str, Floats],
    axes: int = AXES,
) -> None:
    """Raise `ValueError` with all faults of a model; arrays get the dimensions that lists lose where one is 0."""
    wrong = [f"{name} must have the shape {shape}" for name, shape in shapes.items() if not _fits(model, name, shape)]
    wrong += faults
    if wrong:
        raise ValueError("; ".join(wrong))
    for name, R in covariances.items():
        if R.shape != (axes, axes) or not np.array_equal(R, R.T) or np.linalg.eigvalsh(R)[0] <= 0:
            raise ValueError(f"{name} must be symmetric and positive definite")


def rises(values: NDArray[Any]) -> bool:
    """Tell whether each value is larger than the one before."""
    return bool(np.all(np.diff(values) > 0))


def _fits(model: object, name: str, shape: Shape) -> bool:
    """Return whether an array has a shape, and give it that shape where it is empty."""
    array = attrgetter(name)(model)
    if array.shape == shape:
        return True
    # lists end at the first dimension that is 0
    n_known = shape.index(0) + 1 if 0 in shape else len(shape)
    if array.shape != shape[:n_known]:
        return False
    owner, _, field = name.rpartition(".")
    object.__setattr__(attrgetter(owner)(model) if owner else model, field, array.reshape(shape))
    return True
