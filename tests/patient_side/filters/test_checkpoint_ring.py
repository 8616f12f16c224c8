import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tis.patient_side.filters.replay import Checkpoint, Ring, rewound, trimmed


def ring_at(indices: list[int]) -> Ring:
    return tuple(Checkpoint(i, np.zeros(1), None, 1, None, (1.0, 1.0)) for i in indices)


def indices(ring: Ring) -> list[int]:
    return [checkpoint.source_index for checkpoint in ring]


@given(st.sets(st.integers(0, 60)).map(sorted), st.integers(0, 60))
def test_rewound_holds_what_was_before(at: list[int], index: int) -> None:
    assert indices(rewound(ring_at(at), index)) == [i for i in at if i < index]


@given(st.sets(st.integers(0, 60), min_size=1).map(sorted), st.integers(0, 20))
def test_trimmed_can_replay_all_of_its_window_and_holds_one_more(at: list[int], window: int) -> None:
    kept = indices(trimmed(ring_at(at), window))
    before = [i for i in at if i < at[-1] - window]
    assert kept == before[-1:] + [i for i in at if i >= at[-1] - window]
