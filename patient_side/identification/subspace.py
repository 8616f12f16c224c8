"""The common part of all subspace methods: a triangular factor in, A and C by shift invariance, then B, D and x0.

Below a system's own order the shift can fail; A and C are then those of `past_states`.

The methods (`moesp`, `pi_moesp`, `n4sid`, `cva`) differ in the part of the factor that they use, that is, in the part
of the future outputs that the past explains, and in the weighting of its column space, which is that of the extended
observability matrix (Van Overschee and De Moor 1995, Automatica 31:1853).

States as the past's prediction of the future, and A and C by least squares on them.

The shift of the extended observability matrix (`subspace`) gives the A of the system where the order is that of the
system. Below it, the matrix's column space is cut off, is no longer invariant under a shift, and its A answers for no
error in the outputs. The regression of the next state and the output on state and input (Van Overschee and De Moor
1996, "Subspace Identification for Linear Systems", 4.4) is the best prediction one sample ahead that so few states of
the past allow. Its price is a bias where the past's window is too short for the state, which does not fade with the
number of rows; the shift has none.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tis.common.errors import DataError, Fault
from tis.patient_side.identification.hankel import triangular_factor
from tis.patient_side.identification.linear_model import LinearModel, Provenance, Signals, as_trials, check_numbers
from tis.patient_side.identification.noise import (
    covariance_of,
    estimate_noise,
    floored,
    innovations,
    refined_gain,
    riccati_gain,
)
from tis.patient_side.identification.order import NEGLIGIBLE_ERROR, NO_ERROR, Candidate
from tis.patient_side.identification.output_error import (
    STABLE_BELOW,
    fit_inputs,
    fit_inputs_by_innovations,
    stabilised,
)
from tis.patient_side.identification.trials import Scaling, Trial, breakdown_as_fault, check_trials
from tis.patient_side.identification.validation import prediction_error
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace

_LARGE_CONDITION = 1e3
_NEGLIGIBLE = 1e-10
_EXCESS = 0.01
"""Relative excess of the shift's errors above which its dynamics are held against those of the states' regression.

A system's own order has 0.0003 to 0.009 from 1200 rows with little noise, or 15 000 with much, and the comparison
itself still keeps the shift nearly always; a cut-off order mostly has several times as much."""

_WORTH = 0.98
"""Share of the shift's prediction error below which the regression's dynamics are taken: the shift has no bias."""

_SHIFTED_OUT = 1e-6
"""Relative size of a direction without its last block row, below which the shift does not determine its dynamics."""


@dataclass(frozen=True)
class Subspace:
    """A basis (s p, s p) of the outputs' directions, the observable ones first, and their singular values.

    There are s p values, for `pi_moesp` at most s m; ``rank`` of them exceed rounding. ``uses_outputs``: the past
    includes outputs, so that it predicts the state.
    """

    left: Array
    singular_values: Array
    rank: int
    n_outputs: int
    uses_outputs: bool = True


@dataclass(frozen=True)
class Realised:
    """A model of some order, each trial's x0, a warning if it was unstable, and its gain where that was needed."""

    space: StateSpace
    x0: tuple[Array, ...]
    warnings: tuple[str, ...]
    candidate: Candidate | None = None


@dataclass(frozen=True)
class FutureBlocks:
    """The blocks of L in the rows Y_f, named after the rows whose new directions they multiply.

    ``by_past_inputs`` (s p, s m) and ``by_past_outputs`` (s p, s p) are the part that the past explains beyond the
    future inputs; ``unexplained`` (s p, s p) is the rest. ``past`` (s (m+p), s (2m+p)) holds the rows of the past,
    [U_p; Y_p], in the directions of [U_f; U_p; Y_p].
    """

    by_past_inputs: Array
    by_past_outputs: Array
    unexplained: Array
    past: Array
    scale: float
    n_inputs: int
    n_outputs: int

    @classmethod
    def of(cls, factor: Array, block_rows: int, n_inputs: int, n_outputs: int) -> "FutureBlocks":
        """Return the blocks of `triangular_factor`'s result."""
        inputs, outputs = block_rows * n_inputs, block_rows * n_outputs
        future = factor[:, 2 * inputs + outputs :].T
        return cls(
            by_past_inputs=future[:, inputs : 2 * inputs],
            by_past_outputs=future[:, 2 * inputs : 2 * inputs + outputs],
            unexplained=future[:, 2 * inputs + outputs :],
            past=factor[: 2 * inputs + outputs, inputs : 2 * inputs + outputs].T,
            scale=float(np.linalg.norm(future)),
            n_inputs=n_inputs,
            n_outputs=n_outputs,
        )

    @property
    def by_past(self) -> Array:
        """L32 (s p, s (m+p)): the part by past inputs and outputs together."""
        return np.hstack([self.by_past_inputs, self.by_past_outputs])


Method = Callable[[FutureBlocks], Subspace]


def column_space(part: Array, scale: float, n_outputs: int) -> Subspace:
    """Return the column space of a part of the future outputs; values below 1e-10 of ``scale`` are rounding."""
    left, values, _ = np.linalg.svd(part)
    return Subspace(left, values, int(np.count_nonzero(values > _NEGLIGIBLE * scale)), n_outputs)


@breakdown_as_fault("a subspace method")
def identify_subspace(
    name: str, method: Method, u: Signals, y: Signals, order: int, horizon: int, *, stable: bool = True
) -> LinearModel:
    """Identify a linear model by a subspace method; each method's ``identify`` is this with the method filled in.

    Parameters
    ----------
    name, method
        Name and column space of the method, see `methods`.
    u, y
        One trial, (N, m) and (N, p), m may be 0; or one array for each of several trials, whose borders no Hankel
        column crosses. They are neither centred nor modified.
    order
        Number of states n; 0 for y = D u.
    horizon
        Number of block rows of past and future each.
    stable
        Whether unstable poles are moved inside the unit circle.

    Returns
    -------
    LinearModel
        A, B, C, D, each trial's x0, the noise in innovations form, and warnings.

    Raises
    ------
    DataError
        For arrays that `as_arrays` or `check_trials` rejects, inputs that do not excite all directions, and an order
        above (horizon - 1) p, for `pi_moesp` also above horizon x m.

    Examples
    --------
    >>> model = moesp.identify(u, y, order=4, horizon=10)
    >>> simulated = model.space.simulate(u, model.x0[0])
    """
    # Checks, scaling and factor.
    check_numbers(order, horizon)
    trials = as_trials(u, y)
    check_trials(trials, horizon, fewest_inputs=0)
    n_inputs, n_outputs = trials[0][0].shape[1], trials[0][1].shape[1]
    scaling = Scaling.of(trials)
    scaled = scaling.scaled(trials)
    factor = triangular_factor(scaled, horizon)
    weakly = check_excitation(factor, 2 * horizon * n_inputs)
    # The method's column space, the model in it, and the noise.
    found = method(FutureBlocks.of(factor, horizon, n_inputs, n_outputs))
    check_order(order, horizon, n_outputs, shown=len(found.singular_values))
    states = PastStates.of(factor, horizon, n_inputs, n_outputs)
    realised = realise(found, states, order, scaled, horizon, stable=stable)
    space = scaling.unscaled(realised.space)
    noise, no_gain = noise_of(realised, scaling, trials, horizon, stable=stable)
    n_rows = sum(len(inputs) for inputs, _ in trials)
    return LinearModel(
        space,
        realised.x0,
        noise,
        scaling,
        Provenance(name, horizon, order, n_rows, len(trials), found.singular_values),
        (*weakly, *realised.warnings, *no_gain),
    )


def noise_of(
    realised: Realised, scaling: Scaling, trials: Sequence[Trial], block_rows: int, *, stable: bool
) -> tuple[NoiseModel, tuple[str, ...]]:
    """Return the noise of a model of scaled trials in the units of ``trials``, and a warning when K is zero."""
    if stable or realised.candidate is None:
        return estimate_noise(scaling.unscaled(realised.space), realised.x0, trials, block_rows)
    return realised.candidate.noise(scaling), ()


def check_order(order: int, block_rows: int, n_outputs: int, smallest: int = 0, shown: int | None = None) -> None:
    """Raise `DataError` when ``order`` is below ``smallest`` or ``block_rows`` block rows cannot show it.

    ``shown`` is the number of singular values, where it may be smaller than the number of the outputs' Hankel rows.
    """
    largest, why = (block_rows - 1) * n_outputs, "(block rows - 1) x outputs"
    if shown is not None and shown < largest:
        largest, why = shown, "block rows x inputs"
    if not smallest <= order <= largest:
        rule = f"must lie in {smallest}..{largest}, {why}"
        raise DataError(Fault("identification", "order", rule, order))


def check_excitation(factor: Array, n_input_rows: int) -> tuple[str, ...]:
    """Return a warning when the inputs excite some direction weakly; raise `DataError` when not at all.

    ``factor`` is triangular and begins with the inputs' ``n_input_rows`` Hankel rows.
    """
    n = n_input_rows
    if n == 0:
        return ()
    values = np.linalg.svd(factor[:n, :n], compute_uv=False)
    rank = int(np.count_nonzero(values > _NEGLIGIBLE * values[0]))
    if rank < n:
        rule = (
            f"must be persistently exciting: its Hankel matrix has rank {rank} of {n}; choose method arx or fewer"
            " block rows"
        )
        raise DataError(Fault("identification", "input", rule))
    condition = float(values[0] / values[-1])
    if condition <= _LARGE_CONDITION:
        return ()
    return (
        f"the input excites some directions weakly: condition {condition:.2g} of its Hankel matrix,"
        f" above {_LARGE_CONDITION:.0e}",
    )


@dataclass(frozen=True)
class PastStates:
    """Rows in the directions of a triangular factor (d): predicted futures, and the inputs and outputs of a sample.

    ``now`` (d, s p) is the future of a sample as its past predicts it, without the future inputs' part, and ``after``
    (d, s p) that of the next sample, by the same combination of its own past.
    """

    now: Array
    after: Array
    inputs: Array
    outputs: Array

    @classmethod
    def of(cls, factor: Array, block_rows: int, n_inputs: int, n_outputs: int) -> "PastStates":
        """Return the rows of `triangular_factor`'s result, whose columns are [U_f; U_p; Y_p; Y_f]."""
        m, p = n_inputs, n_outputs
        n_u, n_y = block_rows * m, block_rows * p
        future_u, past_u, past_y, future_y = np.split(factor, [n_u, 2 * n_u, 2 * n_u + n_y], axis=1)
        # The oblique projection: the factor's later rows are free of the future inputs.
        new = slice(n_u, 2 * n_u + n_y)
        by_past = np.linalg.lstsq(factor[new, new], future_y[new])[0]
        later_u = np.hstack([past_u[:, m:], future_u[:, :m]])
        later_y = np.hstack([past_y[:, p:], future_y[:, :p]])
        return cls(
            np.hstack([past_u, past_y]) @ by_past,
            np.hstack([later_u, later_y]) @ by_past,
            future_u[:, :m],
            future_y[:, :p],
        )

    def dynamics(self, observability: Array) -> tuple[Array, Array]:
        """Return A (n, n) and C (p, n) in the coordinates of an orthonormal basis (s p, n) of the outputs."""
        n = observability.shape[1]
        known, answers = self._regression(observability)
        found = np.linalg.lstsq(known, answers)[0].T
        return np.asarray(found[:n, :n]), np.asarray(found[n:, :n])

    def excess(self, A: Array, C: Array, observability: Array) -> float:
        """Return by how much, relatively, A and C miss the next state and the output by more than `dynamics` does."""
        known, answers = self._regression(observability)
        least = answers - known @ np.linalg.lstsq(known, answers)[0]
        rest = self.errors(A, C, observability)
        own, other = least.T @ least, rest.T @ rest
        floor = 1e-12 * np.trace(other) * np.eye(len(own))
        return float(np.trace(np.linalg.solve(own + floor, other + floor)) / len(own)) - 1.0

    def errors(self, A: Array, C: Array, observability: Array) -> Array:
        """Return by what A and C, with the best B and D, miss the next state and the output, (d, n + p)."""
        known, answers = self._regression(observability)
        n = len(A)
        rest = answers - known[:, :n] @ np.vstack([A, C]).T
        return np.asarray(rest - known[:, n:] @ np.linalg.lstsq(known[:, n:], rest)[0])

    def _regression(self, observability: Array) -> tuple[Array, Array]:
        known = np.hstack([self.now @ observability, self.inputs])
        return known, np.hstack([self.after @ observability, self.outputs])


def realise(
    found: Subspace,
    states: PastStates,
    order: int,
    trials: Sequence[Trial],
    block_rows: int,
    residuals: Sequence[Array] | None = None,
    *,
    stable: bool = True,
) -> Realised:
    """Return the model of ``order`` states with A and C by shift, or by the states' regression where that is better.

    Better means: on ``trials`` themselves, a 2 % smaller error of predictions 5 samples ahead; so is decided, too,
    whether B and D of the latter serve its filter or its simulation. All are held against each other only where the
    shift's A and C explain the states clearly worse; at a system's own order they do not. Oracle: truncated systems,
    the evaporator of DaISy, test_low_order.
    """
    basis = found.left[:, :order]
    complete = partial(completed if stable else partial(_with_filter, states, basis), trials=trials)
    by_shift = complete(*shifted(found, order))
    doubtful = order > 0 and found.uses_outputs
    if not doubtful or states.excess(by_shift.space.A, by_shift.space.C, basis) <= _EXCESS:
        return by_shift
    with_error = partial(_with_error, trials=trials, block_rows=block_rows, residuals=residuals)
    best, error = with_error(by_shift)
    if error <= (NEGLIGIBLE_ERROR if stable else NO_ERROR):
        return best
    by_states, other = with_error(complete(*states.dynamics(basis)))
    others = ((by_states, other), with_error(_for_filter(by_states, trials))) if stable else ((by_states, other),)
    for each, its_error in others:
        if its_error < _WORTH * error:
            best, error = each, its_error
    return best


def _for_filter(model: Realised, trials: Sequence[Trial]) -> Realised:
    """Return the model with B, D and x0 for its filter's errors instead of its simulation's; not a stabilised one."""
    space, candidate = model.space, model.candidate
    if candidate is None or not candidate.gain.any() or model.warnings:
        return model
    B, D, x0 = fit_inputs_by_innovations(space.A, space.C, candidate.gain, trials)
    return replace(model, space=StateSpace(space.A, B, space.C, D), x0=x0, candidate=None)


def _with_error(
    model: Realised, trials: Sequence[Trial], block_rows: int, residuals: Sequence[Array] | None
) -> tuple[Realised, float]:
    candidate = model.candidate or Candidate.of(model.space, model.x0, trials, block_rows, residuals)
    error = prediction_error(model.space, candidate.gain, trials, 2 * block_rows)
    return replace(model, candidate=candidate), error


def shifted(found: Subspace, order: int) -> tuple[Array, Array]:
    """Return A (n, n) and C (p, n) by the shift of the extended observability matrix."""
    p = found.n_outputs
    observability = found.left[:, :order]
    A = np.empty((0, 0))
    if order:
        A = np.asarray(np.linalg.lstsq(observability[:-p], observability[p:], rcond=_SHIFTED_OUT)[0])
    return A, np.ascontiguousarray(observability[:p])


def completed(A: Array, C: Array, trials: Sequence[Trial]) -> Realised:
    """Return the model with A stabilised, and B, D and x0 fitted to that."""
    A, radius = stabilised(A)
    B, D, x0 = fit_inputs(A, C, trials)
    warnings = (
        f"the model of order {len(A)} was unstable, spectral radius {radius:.6g}: its eigenvalues were moved"
        " inside the unit circle and B, D and x0 fitted to that",
    )
    return Realised(StateSpace(A, B, C, D), x0, () if radius < STABLE_BELOW else warnings)


_PASSES = 2
"""Alternations of B, D and x0 with K: the first K, from the states' regression, is close already."""


def _with_filter(states: PastStates, basis: Array, A: Array, C: Array, trials: Sequence[Trial]) -> Realised:
    """Return the model with A as it is, and with K, B, D and x0 for the one-step errors of its filter.

    A - K C is stable where A is not, so that errors neither grow with the rows nor depend on a distant start.
    """
    if not len(A):
        return completed(A, C, trials)
    gain = riccati_gain(A, C, states.errors(A, C, basis))
    for _ in range(_PASSES):
        B, D, x0 = fit_inputs_by_innovations(A, C, gain, trials)
        space = StateSpace(A, B, C, D)
        gain = refined_gain(space, gain, x0, trials)
    covariance = floored(covariance_of(innovations(space, gain, x0, trials)))
    return Realised(space, x0, (), Candidate(space, gain, covariance))
