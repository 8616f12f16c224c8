from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.learning.tracks import some_examples
from tis.patient_side.learned.networks import NETWORKS
from tis.patient_side.learning.fit_network import Epoch, Judged, first_weights, judge, train_network


def test_first_weights_have_the_variance_of_their_inputs_and_repeat() -> None:
    shapes = {"a.weight": (400, 50), "a.bias": (50,), "head.last.weight": (400, 4)}
    found = first_weights(shapes, 1)
    assert found["a.weight"].var() == pytest.approx(1 / 400, rel=0.05)
    assert not found["a.bias"].any()
    assert found["head.last.weight"].std() == pytest.approx(0.01 / 20, rel=0.1)
    assert np.array_equal(found["a.weight"], first_weights(shapes, 1)["a.weight"])
    assert not np.array_equal(found["a.weight"], first_weights(shapes, 2)["a.weight"])


def test_the_error_is_the_mean_over_ages_of_that_over_the_linear_one() -> None:
    examples = some_examples()
    answers = Judged(0.5 * examples.left.astype(float), np.zeros(examples.ages.shape))
    assert answers.error_of(examples) == pytest.approx(0.5, rel=1e-5)
    assert Judged(np.zeros(examples.left.shape), answers.log_deviation).error_of(examples) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["cnn", "transformer", "informer"])
def test_training_finds_circles_repeats_and_stops_after_the_best_epoch(name: str) -> None:
    pytest.importorskip("jax", reason="needs the extra learned")
    pytest.importorskip("optax", reason="needs the extra learned")
    examples = some_examples(n_tracks=8, n_passes=3)
    seen, held = (examples.rows(np.flatnonzero(examples.groups == group)) for group in (0, 1))
    epochs: list[Epoch] = []
    network = NETWORKS[name]
    first = train_network(name, network, seen, held, 1, 10, 10, epochs.append)
    as_good = np.flatnonzero(first.errors <= 1.005 * first.errors.min())
    assert first.best == as_good[-1] + 1
    assert first.errors.min() < 0.9
    assert [epoch.number for epoch in epochs] == list(range(1, len(first.errors) + 1))
    assert epochs[-1].learned < 0.9
    assert [epoch.error for epoch in epochs] == first.errors.tolist()
    assert judge(network, first.weights, held).error_of(held) == pytest.approx(first.errors[first.best - 1], rel=1e-6)
    again = train_network(name, network, seen, held, 1, 10, 10, epochs.append)
    for key, weight in first.weights.items():
        assert np.array_equal(weight, again.weights[key]), key


def test_training_ends_after_patience_without_a_better_error() -> None:
    pytest.importorskip("optax", reason="needs the extra learned")
    examples = some_examples(n_tracks=4)
    nothing = replace(examples, left=np.zeros_like(examples.left) + 1e-9)
    found = train_network("cnn", NETWORKS["cnn"], examples, nothing, 1, 9, 2, lambda _: None)
    assert len(found.errors) == int(np.argmin(found.errors)) + 3
