"""Rows that grow at one end, against a list that keeps everything."""

from hypothesis import given, settings
from hypothesis import strategies as st

from tis.deploy.watch.motion import Trail


@settings(max_examples=50)
@given(most=st.integers(1, 6), batches=st.lists(st.integers(0, 9), max_size=8))
def test_a_reader_sees_every_row_once_but_those_that_went_before_it_came(most: int, batches: list[int]) -> None:
    trail: Trail[int] = Trail(most)
    everything: list[int] = []
    n_read = 0
    for n in batches:
        for _ in range(n):
            trail.append(len(everything))
            everything.append(len(everything))
        assert trail.since(n_read) == everything[max(n_read, len(everything) - most) :]
        assert trail.all() == everything[-most:]
        n_read = trail.n


def test_a_reader_that_is_ahead_gets_nothing() -> None:
    trail: Trail[str] = Trail(3)
    trail.append("a")
    assert trail.since(1) == trail.since(2) == []
