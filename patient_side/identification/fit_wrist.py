"""Identification of the models of an arm's orientation and gripper."""

from collections.abc import Callable, Collection
from contextlib import AbstractContextManager

from tis.common.errors import DataError
from tis.patient_side.identification.dataset import TrainingSet
from tis.patient_side.identification.direct_ls import fit_direct
from tis.patient_side.movement_models import WristModel
from tis.patient_side.rotations import turned


def fit_wrist(
    training: TrainingSet, wanted: Collection[str] | None, stage: Callable[[str], AbstractContextManager[None]]
) -> tuple[WristModel | None, tuple[str, ...]]:
    """Return the models for the orientation methods ``wanted`` (None: all), and warnings; None: none is wanted.

    Trials too short for least squares give no such model and a warning: the answers then hold the orientation.
    ``stage`` measures each fit.
    """
    orientations, rate_hz = training.orientations, training.rate_hz
    grippers = [angles[:, None] for angles in training.grippers_rad]
    if wanted is not None and "tangent_ls" not in wanted:
        return None, ()
    try:
        with stage("tangent_ls"):
            direct = fit_direct(orientations, rate_hz, turned)
            return WristModel(direct, fit_direct(grippers, rate_hz)), ()
    except DataError as error:
        return None, (f"no model for tangent_ls: {'; '.join(map(str, error.faults))}",)
