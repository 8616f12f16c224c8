"""The models of the runs that tests make: identified once for all workers, for most runs begin with the same ones."""

import copy
import hashlib
import os
import pickle
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from tis.common.channels import Hand
from tis.common.scenario.estimator_names import is_user_defined
from tis.common.scenario.identification import Identification
from tis.common.sources.trajectory import Recording
from tis.deploy.tools import identify
from tis.patient_side import build
from tis.patient_side.identification import fit_drmf
from tis.patient_side.identification.companions import Stage, untimed
from tis.patient_side.identification.identify import Identified, identify_hands

_FOUND: dict[str, tuple[Identified, ...]] = {}
_NEED_NONE = {"hold", "damped_velocity", "moesp_kf"}  # estimators without a model beside the chosen one


def hands_once(
    kept: Path,
    trainings: Sequence[Recording],
    hands: Sequence[Hand],
    identification: Identification,
    pairing: str,
    wanted: Collection[str] | None = (),
    stage: Stage = untimed,
) -> tuple[Identified, ...]:
    """Return what `identify_hands` returns, a copy of its own for each caller; a failure is not kept.

    Other workers find it in the folder ``kept``. Two that need it at the same time both identify it: nobody waits.
    """
    # which of one's own it is plays no part: for each of them all models are tried
    names = wanted and sorted({"own" if is_user_defined(name) else name for name in wanted} - _NEED_NONE)
    anywhere = [replace(each, file=None) for each in trainings]
    asked = pickle.dumps((anywhere, list(hands), identification.model_dump_json(), pairing, names))
    key = hashlib.sha256(asked).hexdigest()
    if key not in _FOUND:
        file = kept / key
        if file.exists():
            _FOUND[key] = pickle.loads(file.read_bytes())
        else:
            with pytest.MonkeyPatch.context() as patch:
                if "drmf" not in (names or ()):  # nobody asks for it, and it would take longer than all others
                    judge_by_few_draws(patch)
                _FOUND[key] = identify_hands(trainings, hands, identification, pairing, wanted, stage)
            _write_whole(file, pickle.dumps(_FOUND[key]))
    return copy.deepcopy(_FOUND[key])


def judge_by_few_draws(patch: pytest.MonkeyPatch) -> None:
    """Judge and calibrate DRMF by few draws: enough where the best choice is far ahead, or does not matter."""
    patch.setattr(fit_drmf, "_N_JUDGED", 5)
    patch.setattr(fit_drmf, "_N_CALIBRATED", 30)


@contextmanager
def models_identified(kept: Path | None) -> Iterator[None]:
    """Let runs and `tis identify` in this process take what has been identified before, or identify all anew.

    ``kept`` is the folder of what has been identified, None to identify anew.
    """
    with pytest.MonkeyPatch.context() as patch:
        once = partial(hands_once, kept) if kept else identify_hands
        patch.setattr(build, "identify_hands", once)
        patch.setattr(identify, "identify_hands", once)
        yield


def _write_whole(path: Path, content: bytes) -> None:
    """Write a file that other workers see as a whole or not at all."""
    part = path.with_name(f"{path.name}.{os.getpid()}")
    part.write_bytes(content)
    part.replace(path)
