"""A finite Markov chain with one step per packet, in blocks."""

from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import BLOCK
from tis.netem.draws.blocks import Floats

States = NDArray[np.uint8]

_MAX_STATES: Final = 255
_ROW_SUM_TOLERANCE: Final = 1e-9
_STRIDE: Final = 64
_INDICES: Final = np.arange(BLOCK, dtype=np.int32)


class MarkovChain:
    """A chain by its transition probabilities, (n, n), rows sum to 1; its states are those that state 0 leads to.

    One uniform u makes one step, by the inverse of the row's distribution function: the next state is the first one
    whose cumulated probability is above u. Raises ValueError for another matrix.
    """

    def __init__(self, transition: NDArray[np.float64]) -> None:
        n_states = len(transition)
        if transition.shape != (n_states, n_states) or not 0 < n_states <= _MAX_STATES:
            raise ValueError(f"transition must be square with 1 to {_MAX_STATES} states (got {transition.shape})")
        if (transition < 0).any() or (abs(transition.sum(axis=1) - 1) > _ROW_SUM_TOLERANCE).any():
            raise ValueError("rows of transition must be probabilities that sum to 1")
        self.transition = transition
        self._cumulated = np.cumsum(transition, axis=1)[:, :-1]  # the last state takes all the rest

    @cached_property
    def stationary(self) -> Floats:
        """Return the share of time in each state, (n,); 0 in states that state 0 does not lead to.

        By the elimination of Grassmann, Taksar and Heyman (1985), which has no subtraction: rare steps keep all their
        digits. Raises ValueError when the chain can leave state 0 forever (oracle: power iteration, test_markov).
        """
        n_states = len(self.transition)
        leads = np.linalg.matrix_power((np.eye(n_states) + self.transition > 0).astype(float), n_states) > 0
        lived_in = leads[0]
        if not leads[lived_in, 0].all():
            raise ValueError("every state that state 0 leads to must lead back to it")
        # eliminate the states from the last to the first, then substitute back
        P = self.transition[np.ix_(lived_in, lived_in)]
        for k in range(len(P) - 1, 0, -1):
            P[:k, k] /= P[k, :k].sum()
            P[:k, :k] += np.outer(P[:k, k], P[k, :k])
        share = np.ones(len(P))
        for k in range(1, len(P)):
            share[k] = share[:k] @ P[:k, k]
        result = np.zeros(n_states)
        result[lived_in] = share / share.sum()
        return result

    def after(self, state: int, n_steps: int) -> Floats:
        """Return the probabilities, (n,), of the states ``n_steps`` >= 0 steps after ``state``."""
        return np.asarray(np.linalg.matrix_power(self.transition, n_steps)[state])

    def draw(self, u: float) -> int:
        """Return a state of the stationary distribution, by the inverse of its distribution function at u."""
        state = int(np.searchsorted(np.cumsum(self.stationary)[:-1], u, side="right"))
        while self.stationary[state] == 0:  # the shares sum to 1 but for rounding, so their sum may lie below u
            state -= 1
        return state

    def walk(self, u: Floats, state: int) -> States:
        """Return the states at N packets, (N,), from one uniform each and the state before the first packet."""
        if len(self.transition) == 1:
            return np.zeros(len(u), np.uint8)
        if len(self.transition) == 2:
            p, stay = float(self._cumulated[0, 0]), float(self._cumulated[1, 0])
            return _walk_two(u, p, stay, state)
        return _walk_many(u, self._cumulated, state)


def _walk_many(u: Floats, cumulated: Floats, state: int) -> States:
    """Walk a chain of n states: stretches of 64 steps in parallel, each from every state, then joined.

    A loop over the steps takes twice as long and leaves thousands of objects to the garbage collector.
    """
    n_states, n_stretches = len(cumulated), -(-len(u) // _STRIDE)
    padded = np.append(u, np.zeros(n_stretches * _STRIDE - len(u)))
    # stage 1: the successor of every state at every step
    following = np.zeros((n_states, len(padded)), np.uint8)
    for states, row in zip(following, cumulated, strict=True):
        for threshold in row:
            states += padded >= threshold
    # stage 2: the state reached at each step of each stretch, from each state before the stretch
    # (step in its stretch, stretch, state before it), flat in the last two
    steps = np.ascontiguousarray(following.reshape(n_states, n_stretches, _STRIDE).transpose(2, 1, 0))
    steps = steps.reshape(_STRIDE, n_stretches * n_states)
    rows = np.repeat(np.arange(n_stretches) * n_states, n_states)
    reached = np.empty_like(steps)
    reached[0] = steps[0]
    for i in range(1, _STRIDE):
        reached[i] = steps[i][rows + reached[i - 1]]
    # stage 3: the state before each stretch, and with it the one path that was taken
    begins = []
    for ends in reached[-1].reshape(n_stretches, n_states).tolist():
        begins.append(state)
        state = ends[state]
    taken = np.arange(n_stretches) * n_states + begins
    return np.ascontiguousarray(reached[:, taken].T).reshape(-1)[: len(u)]


def _walk_two(u: Floats, stays_0: float, returns_0: float, state: int) -> States:
    """Walk a chain of two states without a loop.

    A uniform below or above both thresholds forces the next state, whatever the present one. Between the thresholds
    it keeps the state, or swaps it where P(1 to 0) exceeds P(0 to 0). So the state is the last one forced,
    swapped as often as a swap occurred since (oracle: the loop, tests/netem/draws/test_markov).
    """
    low, high = min(stays_0, returns_0), max(stays_0, returns_0)
    forced = (u < low) | (u >= high)
    indices = _INDICES if len(u) == BLOCK else np.arange(len(u), dtype=np.int32)
    last = np.maximum.accumulate(np.where(forced, indices, -1))
    before = last < 0
    to_1 = u >= high
    path = np.where(before, bool(state), to_1[last])
    if returns_0 > stays_0:  # between the thresholds 0 leaves and 1 returns
        swaps = np.cumsum(~forced, dtype=np.int32)
        path ^= ((swaps - np.where(before, 0, swaps[last])) & 1).astype(np.bool_)
    return path.view(np.uint8)
