"""The models of the runs that tests make: identified once in each worker, for most runs begin with the same ones."""

import copy
import pickle
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager

import pytest

from common.channels import Hand
from common.scenario.patient import Identification
from common.sources.trajectory import Recording
from deploy.tools import identify
from patient_side import build
from patient_side.identification.identify import Identified, identify_arm, identify_with_orders
from patient_side.statespace import ArmModel

_FOUND: dict[bytes, Identified] = {}


def with_orders_once(
    trainings: Sequence[Recording],
    hand: Hand,
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None = (),
) -> Identified:
    """Return what `identify_with_orders` returns, a copy of its own for each caller; a failure is not kept."""
    names = None if wanted is None else sorted(wanted)
    key = pickle.dumps((list(trainings), hand, identification.model_dump_json(), pairing, names))
    if key not in _FOUND:
        _FOUND[key] = identify_with_orders(trainings, hand, identification, pairing, wanted)
    return copy.deepcopy(_FOUND[key])


def arm_once(
    trainings: Sequence[Recording],
    hand: Hand,
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None = (),
) -> ArmModel:
    """Return what `identify_arm` returns, likewise."""
    return with_orders_once(trainings, hand, identification, pairing, wanted).model


@contextmanager
def models_identified(once: bool) -> Iterator[None]:
    """Let runs and `tis identify` in this process take what has been identified before, or identify all anew."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "identify_arm", arm_once if once else identify_arm)
        patch.setattr(identify, "identify_with_orders", with_orders_once if once else identify_with_orders)
        yield
