"""What is kept of covariances changes nothing, and is bounded."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.movements import movement_model
from tis.patient_side.filters import replay
from tis.patient_side.filters.innovations_filter import build_innovations_filter
from tis.patient_side.filters.replay import Uncertainty, UncertaintyTree

FILTER = build_innovations_filter(movement_model(4), 20)


@given(st.lists(st.lists(st.integers(1, 20), min_size=1, max_size=16), min_size=1, max_size=4))
@settings(max_examples=20, deadline=None)
def test_it_is_the_filters_own_update_again_and_again(walks: list[list[int]]) -> None:
    tree = UncertaintyTree(FILTER)
    for gaps in walks + walks:
        here, covariance = tree.root(0, FILTER.start_covariance), FILTER.start_covariance
        for gap in gaps:
            taken, (weights, variance, covariance) = tree.take(here, gap), FILTER.gain(covariance, gap)
            assert np.array_equal(taken.weights, weights)
            assert np.array_equal(taken.covariance, covariance)
            assert taken.variance == variance
            here = taken


def test_from_one_root_it_is_worked_out_once() -> None:
    tree = UncertaintyTree(FILTER)
    root = tree.root(3, FILTER.start_covariance)
    assert tree.root(3, FILTER.start_covariance) is root
    assert tree.take(root, 2) is tree.take(root, 2)


def test_a_row_that_stays_broken_keeps_no_chain() -> None:
    tree = UncertaintyTree(FILTER)
    here = tree.root(0, FILTER.start_covariance)
    for _ in range(40):
        here = tree.take(here, 2)
    assert here.after is None


def test_what_is_kept_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replay, "_MAX_KEPT", 10)
    tree = UncertaintyTree(FILTER)
    for stage in range(50):
        tree.take(tree.root(stage, FILTER.start_covariance), 2)
    assert len(tree._roots) <= 11
    alone = Uncertainty(FILTER.start_covariance)  # of no root: nothing after it is kept
    tree.take(alone, 1)
    assert alone.after is None
