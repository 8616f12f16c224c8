"""Identification of the models of an arm's orientation and gripper."""

from collections.abc import Callable, Collection
from contextlib import AbstractContextManager

from common.errors import DataError
from patient_side.identification.dataset import TrainingSet
from patient_side.identification.direct_ls import fit_direct
from patient_side.identification.fit_rate import fit_rate
from patient_side.identification.second_moments import differences
from patient_side.rotations import turned
from patient_side.wrist_model import WristModel


def fit_wrist(
    training: TrainingSet, wanted: Collection[str] | None, stage: Callable[[str], AbstractContextManager[None]]
) -> tuple[WristModel | None, tuple[str, ...]]:
    """Return the models for the orientation methods ``wanted`` (None: all), and warnings; None: none is wanted.

    Trials too short for least squares give no such model and a warning: the answers then hold the orientation.
    ``stage`` measures each fit.
    """
    orientations, rate_hz = training.orientations, training.rate_hz
    grippers = [angles[:, None] for angles in training.grippers_rad]
    rate = gripper_rate = direct = gripper_direct = None
    warnings: tuple[str, ...] = ()
    if wanted is None or "constant_rate" in wanted:
        with stage("constant_rate"):
            rate = fit_rate(orientations, rate_hz, turned)
            gripper_rate = fit_rate(grippers, rate_hz, differences)
    if wanted is None or "tangent_ls" in wanted:
        try:
            with stage("tangent_ls"):
                direct = fit_direct(orientations, rate_hz, turned)
                gripper_direct = fit_direct(grippers, rate_hz)
        except DataError as error:
            warnings = (f"no model for tangent_ls: {'; '.join(map(str, error.faults))}",)
    if rate is None and direct is None:
        return None, warnings
    return WristModel(rate, gripper_rate, direct, gripper_direct), warnings
