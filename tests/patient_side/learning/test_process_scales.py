import numpy as np
import pytest

from tests.patient_side.learning.tracks import some_examples
from tis.common.streams import Stream
from tis.patient_side.learned.gaussian_process import AGES, GROUPS, N_FEATURES
from tis.patient_side.learning.process_scales import chosen_rows, inverse_lengths, turned


def test_chosen_rows_differ_and_repeat() -> None:
    rows = chosen_rows(100, 30, Stream.named(1, "a"))
    assert len(set(rows.tolist())) == 30
    assert np.array_equal(rows, chosen_rows(100, 30, Stream.named(1, "a")))
    assert len(chosen_rows(10, 30, Stream.named(1, "a"))) == 10


def test_turned_examples_keep_lengths_and_angles() -> None:
    before = some_examples(n_tracks=2)
    after = turned(before, 1)
    for ours, theirs in ((before.left, after.left), (before.window.way, after.window.way)):
        np.testing.assert_allclose(np.linalg.norm(ours, axis=2), np.linalg.norm(theirs, axis=2), rtol=1e-4, atol=1e-5)
    along = [np.einsum("bka,bka->bk", each.left, each.moves) for each in (before, after)]
    np.testing.assert_allclose(along[0], along[1], rtol=1e-3, atol=1e-2)
    assert not np.allclose(before.left, after.left)


def test_the_feature_that_matters_has_the_shortest_length_and_axes_share_theirs() -> None:
    pytest.importorskip("sklearn", reason="needs the extra learned")
    rng = np.random.default_rng(0)
    features = rng.normal(size=(300, N_FEATURES))
    left = np.zeros((300, len(AGES), 3))
    left += np.sin(2.0 * features[:, :1])[:, :, None] + 0.1 * rng.normal(size=left.shape)
    found = inverse_lengths(features, left, 1)
    assert found.shape == (N_FEATURES,)
    assert found[0] == found[1] == found[2]
    others = found[GROUPS[0] != GROUPS]
    assert found[0] > 3 * others.max()
