"""Limit of the turning of a set point: towards the estimate, by a largest angle a tick."""

from math import sqrt

import numpy as np

from patient_side.orientation.wrist import Wrist, components, quaternion
from patient_side.rotations import turned, turned_by


def turn_towards(wrist: Wrist, target: Wrist, most_rad: float) -> Wrist:
    """Return the next orientation and gripper on the shortest way to ``target``, each by ``most_rad`` at most.

    What is near enough is the target's itself, bit for bit. Oracle in test_turn_limit: SciPy's rotations.
    """
    here = np.array(components(wrist.orientation))
    way = turned(here, np.array(components(target.orientation)))
    angle_rad = sqrt(float(way @ way))
    orientation = target.orientation
    if angle_rad > most_rad:
        orientation = quaternion(turned_by(here, way * (most_rad / angle_rad)))
    opened_rad = target.gripper_rad - wrist.gripper_rad
    gripper_rad = target.gripper_rad
    if abs(opened_rad) > most_rad:
        gripper_rad = wrist.gripper_rad + (most_rad if opened_rad > 0.0 else -most_rad)
    return Wrist(orientation, gripper_rad)
