"""Joint states of the network: one path through named states, the same for both directions."""

from bisect import bisect_right
from collections.abc import Callable
from itertools import accumulate, pairwise
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network.conditions import CycleStates, MarkovState, MarkovStates, ScriptedStates, States
from tis.common.streams import Stream
from tis.common.units import s_to_ns
from tis.netem.draws import grid
from tis.netem.draws.blocks import Floats
from tis.netem.draws.grid import Cells, Path, RenewalPath, Stretch
from tis.netem.draws.markov import MarkovChain

NO_STATE: Final = -1
_LABEL: Final = "both/*/states"


class StatePath:
    """The state at each run time; it does not depend on the order of access."""

    def __init__(self, names: tuple[str, ...], path: Path) -> None:
        self.names = names
        self._path = path

    @classmethod
    def of(cls, states: States, seed: int) -> Self:
        """Return the path of a scenario's states."""
        names = tuple(state.name for state in states.states)
        if len(names) == 1 and not isinstance(states, ScriptedStates):
            return cls(names, _Always())
        if isinstance(states, MarkovStates):
            return cls(names, RenewalPath(_stays(states.states, Stream.named(seed, _LABEL))))
        if isinstance(states, CycleStates):
            return cls(names, _Cycle(states))
        return cls(names, _Script(states))

    def at(self, cell: int) -> Stretch:
        """Return the stretch that contains ``cell`` >= 0, its value an index into ``names`` or `NO_STATE`."""
        return self._path.at(cell)

    def prepare(self, cell: int) -> None:
        """Make the draws after ``cell`` ahead of their use."""
        self._path.prepare(cell)


def state_shares(states: States) -> dict[str, float]:
    """Return the expected long-run share of time in each state, exactly; a script stays in its last state.

    Each closed class of a Markov chain is weighted with the probability that the chain ends in it. Oracle: a long
    simulation and, for cycles, a superperiod counted cell by cell, tests/netem/conditions/test_states.
    """
    names = [state.name for state in states.states]
    if isinstance(states, ScriptedStates):
        return {name: float(name == states.steps[-1].state) for name in names}
    if isinstance(states, CycleStates):
        cycle = _Cycle(states)
        edges_ns = [edge_ns - cycle.offset_ns for edge_ns in (0, *cycle.ends_ns)]
        lengths = [grid.mean_cells(begin, end - begin, cycle.every_ns) for begin, end in pairwise(edges_ns)]
        return _by_name(names, [length * grid.CELL_NS / cycle.every_ns for length in lengths])
    means = np.array([state.mean_s for state in states.states])
    return _by_name(names, _shares_of_time(_transition(states.states), means).tolist())


def _by_name(names: list[str], shares: list[float]) -> dict[str, float]:
    """Add up the shares of equal names: a cycle may contain a state twice."""
    total = dict.fromkeys(names, 0.0)
    for name, share in zip(names, shares, strict=True):
        total[name] += share
    return total


def _transition(states: tuple[MarkovState, ...]) -> Floats:
    """Return the probabilities (n, n) of the successors of each stay."""
    index = {state.name: i for i, state in enumerate(states)}
    weights = np.zeros((len(states), len(states)))
    for i, state in enumerate(states):
        for successor in state.next:
            weights[i, index[successor.to]] += successor.weight
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _stays(
    states: tuple[MarkovState, ...], stream: Stream
) -> Callable[[int, int], tuple[Cells, NDArray[np.integer]]]:
    """Return the chunks of a path: uniform 2k decides the state of stay k, uniform 2k + 1 its length.

    Stay 0 is in the first state.
    """
    chain = MarkovChain(_transition(states))
    means = np.array([state.mean_s * grid.CELLS_PER_S for state in states])

    def draw(number: int, before: int) -> tuple[Cells, NDArray[np.integer]]:
        u = stream.block(number)
        path = np.append([0], chain.walk(u[2::2], 0)) if number == 0 else chain.walk(u[0::2], before)
        return grid.geometric_cells(u[1::2], means[path]), path

    return draw


def _shares_of_time(transition: Floats, mean_stays: Floats) -> Floats:
    n_states = len(transition)
    steps = (np.eye(n_states) + transition > 0).astype(float)
    leads = np.linalg.matrix_power(steps, n_states) > 0
    recurs = np.array([leads[leads[i], i].all() for i in range(n_states)])
    closed = {tuple(np.flatnonzero(leads[i])) for i in np.flatnonzero(recurs)}
    shares = np.zeros(n_states)
    for members in (np.array(states) for states in sorted(closed)):
        share = MarkovChain(transition[np.ix_(members, members)]).stationary * mean_stays[members]
        shares[members] = _p_ends_in(transition, np.flatnonzero(~recurs), members) * share / share.sum()
    return shares


def _p_ends_in(transition: Floats, transient: NDArray[np.intp], members: NDArray[np.intp]) -> float:
    """Return the probability that the chain, begun in state 0, ends among ``members``: (I - T) p = R 1."""
    if 0 not in transient:
        return float(0 in members)
    stays = np.asarray(transition[np.ix_(transient, transient)], np.float64)
    enters = np.asarray(transition[np.ix_(transient, members)].sum(axis=1), np.float64)
    return float(np.linalg.solve(np.eye(len(transient)) - stays, enters)[0])  # state 0 is the first transient one


class _Always(Path):
    def at(self, cell: int) -> Stretch:  # noqa: ARG002
        return Stretch(0, grid.LAST_CELL, 0)


class _Cycle(Path):
    """A cycle of states; each nominal edge moves to its nearest cell by itself, so rounding does not accumulate."""

    def __init__(self, states: CycleStates) -> None:
        self.ends_ns = tuple(accumulate(s_to_ns(state.for_s) for state in states.states))
        self.every_ns = self.ends_ns[-1]
        self.offset_ns = s_to_ns(states.offset_s)

    def at(self, cell: int) -> Stretch:
        since_ns = grid.deciding_ns(cell) + self.offset_ns
        into_ns = since_ns % self.every_ns
        zero_ns = since_ns - into_ns - self.offset_ns
        index = next(i for i, end_ns in enumerate(self.ends_ns) if into_ns < end_ns)
        begin_ns = zero_ns + (self.ends_ns[index - 1] if index else 0)
        return Stretch(max(0, grid.nearest_cell(begin_ns)), grid.nearest_cell(zero_ns + self.ends_ns[index]), index)


class _Script(Path):
    def __init__(self, states: ScriptedStates) -> None:
        names = [state.name for state in states.states]
        self._edges = [0, *(grid.nearest_cell(s_to_ns(step.at_s)) for step in states.steps), grid.LAST_CELL]
        self._values = [NO_STATE, *(names.index(step.state) for step in states.steps)]

    def at(self, cell: int) -> Stretch:
        i = min(bisect_right(self._edges, cell), len(self._values)) - 1
        return Stretch(self._edges[i], self._edges[i + 1], self._values[i])
