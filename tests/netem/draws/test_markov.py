import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tis.common.streams import BLOCK, Stream
from tis.netem.draws.markov import MarkovChain

U = Stream.named(1, "markov").uniforms(0, BLOCK)
p = st.floats(0, 1)


def stepped(P: NDArray[np.float64], u: NDArray[np.float64], state: int) -> list[int]:
    """The definition, step by step."""
    path = []
    for one in u.tolist():
        total, row = 0.0, P[state]
        for state in range(len(row)):
            total += row[state]
            if one < total:
                break
        path.append(state)
    return path


@given(p=p | st.just(1.0), r=p | st.just(1.0), state=st.integers(0, 1), n=st.integers(1, 700))
def test_two_states_walk_as_step_by_step(p: float, r: float, state: int, n: int) -> None:
    P = np.array([[1 - p, p], [r, 1 - r]])
    assert MarkovChain(P).walk(U[:n], state).tolist() == stepped(P, U[:n], state)


@pytest.mark.parametrize(("p", "r"), [(0.01, 0.2), (0.9, 0.7), (1.0, 1.0), (0.5, 0.5), (1.0, 0.3)])
def test_two_states_walk_a_whole_block(p: float, r: float) -> None:
    P = np.array([[1 - p, p], [r, 1 - r]])
    assert MarkovChain(P).walk(U, 1).tolist() == stepped(P, U, 1)


@given(
    weights=st.integers(3, 6).flatmap(
        lambda n: st.lists(st.lists(st.floats(0.01, 1), min_size=n, max_size=n), min_size=n, max_size=n)
    ),
    n=st.integers(1, 300),
)
def test_many_states_walk_as_step_by_step(weights: list[list[float]], n: int) -> None:
    P = np.array(weights)
    P /= P.sum(axis=1, keepdims=True)
    assert MarkovChain(P).walk(U[:n], 2).tolist() == stepped(P, U[:n], 2)


@given(weights=st.lists(st.lists(st.floats(0.001, 1), min_size=4, max_size=4), min_size=4, max_size=4))
def test_stationary_distribution_is_where_many_steps_lead(weights: list[list[float]]) -> None:
    P = np.array(weights)
    P /= P.sum(axis=1, keepdims=True)
    chain = MarkovChain(P)
    assert chain.stationary == pytest.approx(chain.after(3, 1 << 14), abs=1e-9)
    assert chain.after(2, 1) == pytest.approx(P[2])


def test_rare_steps_keep_their_digits() -> None:
    chain = MarkovChain(np.array([[1.0, 1e-200], [1.0, 0.0]]))
    assert chain.stationary[1] == pytest.approx(1e-200, rel=1e-12)


def test_states_that_are_never_entered_have_no_share() -> None:
    chain = MarkovChain(np.array([[0.5, 0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert chain.stationary == pytest.approx([2 / 3, 1 / 3, 0])
    assert [chain.draw(u) for u in (1e-9, 0.6, 0.7, 1 - 2**-53)] == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("transition", "rule"),
    [
        ([[0.5, 0.4], [0.5, 0.5]], "sum to 1"),
        ([[1.5, -0.5], [0.5, 0.5]], "probabilities"),
        ([[0.5, 0.5]], "square"),
    ],
)
def test_what_is_no_chain_is_refused(transition: list[list[float]], rule: str) -> None:
    with pytest.raises(ValueError, match=rule):
        MarkovChain(np.array(transition))


def test_a_chain_without_return_has_no_stationary_distribution() -> None:
    with pytest.raises(ValueError, match="lead back"):
        _ = MarkovChain(np.array([[0.5, 0.5], [0.0, 1.0]])).stationary
