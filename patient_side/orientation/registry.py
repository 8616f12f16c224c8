"""Orientation methods by the names that scenarios use."""

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Final

from tis.common.scenario.patient import OrientationMethod
from tis.patient_side.movement_models import WristModel
from tis.patient_side.orientation.constant_rate import ConstantRate
from tis.patient_side.orientation.hold import Hold
from tis.patient_side.orientation.protocol import WristMethod
from tis.patient_side.orientation.tangent_ls import TangentLs


def _constant_rate(model: WristModel) -> WristMethod | None:
    if model.rate is None or model.gripper_rate is None:
        return None
    return ConstantRate(model.rate, model.gripper_rate)


def _tangent_ls(model: WristModel) -> WristMethod | None:
    if model.direct is None or model.gripper_direct is None:
        return None
    return TangentLs(model.direct, model.gripper_direct)


METHODS: Final[Mapping[OrientationMethod, Callable[[WristModel], WristMethod | None]]] = MappingProxyType(
    {"hold": lambda _: Hold(), "constant_rate": _constant_rate, "tangent_ls": _tangent_ls}
)


def build_methods(names: Iterable[OrientationMethod], model: WristModel | None) -> tuple[WristMethod, ...]:
    """Return the methods called ``names``, without those that the model has nothing for; hold needs nothing.

    So a model file from before orientations were estimated serves as it did: its arm's orientation is held.
    """
    built = (METHODS[name](WristModel() if model is None else model) for name in names)
    return tuple(method for method in built if method is not None)
