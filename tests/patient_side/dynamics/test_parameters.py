import numpy as np
import pytest

from tis.patient_side.dynamics.parameters import NAMES, joints, links, pseudo_inertia, true_parameters


def test_the_pseudo_inertia_is_the_sum_over_point_masses() -> None:
    rng = np.random.default_rng(2)
    mass, place = rng.uniform(0.1, 1.0, 12), rng.normal(0.0, 0.1, (12, 3))
    homogeneous = np.hstack([place, np.ones((12, 1))])
    expected = np.einsum("k,ki,kj->ij", mass, homogeneous, homogeneous)
    inertia = sum(m * (c @ c * np.eye(3) - np.outer(c, c)) for m, c in zip(mass, place, strict=True))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia
    link = np.array([mass.sum(), *(mass @ place), xx, yy, zz, xy, xz, yz])
    assert pseudo_inertia(link) == pytest.approx(expected, abs=1e-12)


def test_the_arm_s_links_are_bodies_that_can_exist() -> None:
    for link in links(true_parameters(1.0)):
        assert np.linalg.eigvalsh(pseudo_inertia(link))[0] > 0.0


def test_the_vector_goes_link_by_link() -> None:
    values = true_parameters(2.0)
    assert (len(values), len(NAMES)) == (91, 91)
    assert values[NAMES.index("m_3")] == 0.55
    assert values[NAMES.index("coulomb_1")] == 0.24  # twice the model's
    assert joints(values)[2].tolist() == [0.30, 4.0, 1.2]
