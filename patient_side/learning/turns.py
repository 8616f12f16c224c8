"""Random rotations of examples: the hand has no preferred direction."""

import numpy as np
import scipy

from tis.patient_side.learned_model import Singles
from tis.patient_side.model_fields import Floats


def rotations(drawn: Floats) -> Singles:
    """Return rotation matrices (B, 3, 3), uniform over all, from uniforms (B, 3) (Shoemake 1992).

    Oracle: they are orthogonal, of determinant 1, and turn a vector into every direction alike.
    """
    a, b = np.sqrt(1.0 - drawn[:, 0]), np.sqrt(drawn[:, 0])
    s, t = 2.0 * np.pi * drawn[:, 1], 2.0 * np.pi * drawn[:, 2]
    quaternions = np.column_stack([a * np.sin(s), a * np.cos(s), b * np.sin(t), b * np.cos(t)])
    return np.asarray(scipy.spatial.transform.Rotation.from_quat(quaternions).as_matrix(), dtype=np.float32)
