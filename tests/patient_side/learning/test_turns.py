import numpy as np

from tis.patient_side.learning.examples import rotations


def test_rotations_turn_and_nothing_else() -> None:
    drawn = np.random.default_rng(0).random((2000, 3))
    found = rotations(drawn).astype(float)
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), np.broadcast_to(np.eye(3), found.shape), atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-5)
    np.testing.assert_allclose((found @ [0.0, 0.0, 1.0]).mean(axis=0), 0.0, atol=0.05)
    np.testing.assert_allclose(((found @ [1.0, 0.0, 0.0]) ** 2).mean(axis=0), 1 / 3, atol=0.03)
