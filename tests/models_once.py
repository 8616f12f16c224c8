"""The models of the runs that tests make: identified once in each worker, for most runs begin with the same ones."""

import copy
import pickle
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager

import pytest

from common.channels import Hand
from common.scenario.patient import Identification
from common.sources.trajectory import Recording
from patient_side import build
from patient_side.identification.identify import identify_arm
from patient_side.statespace import ArmModel

_MODELS: dict[bytes, ArmModel] = {}


def identify_once(
    trainings: Sequence[Recording],
    hand: Hand,
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None = (),
) -> ArmModel:
    """Return what `identify_arm` returns, a copy of its own for each caller; a failure is not kept."""
    names = None if wanted is None else sorted(wanted)
    key = pickle.dumps((list(trainings), hand, identification.model_dump_json(), pairing, names))
    if key not in _MODELS:
        _MODELS[key] = identify_arm(trainings, hand, identification, pairing, wanted)
    return copy.deepcopy(_MODELS[key])


@contextmanager
def models_identified(once: bool) -> Iterator[None]:
    """Let runs in this process take models that have been identified before, or identify each anew."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "identify_arm", identify_once if once else identify_arm)
        yield
