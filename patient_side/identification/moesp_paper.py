"""MOESP as in the paper: ordinary MOESP on one set of block Hankel matrices (its Algorithm 2).

The paper is Lashari, Batayneh, Khokhar and Ahmed, "Enhanced Position Estimation in Tactile Internet-Enabled
Remote Robotic Surgery Using MOESP-Based Kalman Filter". Its signals are min-max normalised, to [0, 1] on each
channel, and not centred: the lower ends of the ranges are the operating point. The constant that the model needs
there appears as a state of its own with an eigenvalue at 1.

With ``Y = O X + Psi U`` for depth d, the factor ``[U; Y] = [R11 0; R21 R22] Q`` separates the part of Y that the
inputs of the same stretch do not explain: the left singular vectors of R22 span O. ``O_k = U1 sqrt(S1)`` gives C as
its first block row and A by its shift invariance. The vectors beyond the order, ``L1 = U2'``, annihilate O, so that
``M1 = L1 R21 R11^-1 = L1 Psi``, linear in D and B.

The listing specifies only "form M and L". The construction consistent with its other lines (B under D in the
solution) is Verhaegen and Dewilde's (1992, Int. J. Control 56:1187): Psi is block Toeplitz, its k-th block column
is ``[0; D; C B; C A B; ...]``, D in block row k, so with L1 split into blocks of p columns

    M = [M1(1); ...; M1(d)],    L = [L1(k), [L1(k+1) ... L1(d)] O_k(first d - k block rows)], k = 1..d.

The state is scaled as in the printed listing: the data are not divided by the root of the number of columns.

The paper's identification: min-max scaling, Algorithm 2, order by 85 % energy, empirical Q and R.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.scenario.identification import Identification
from tis.patient_side.identification.dataset import TrainingSet
from tis.patient_side.identification.hankel import block_hankel
from tis.patient_side.identification.noise import floored
from tis.patient_side.identification.order import (
    Candidate,
    Fitted,
    OrderChoice,
    choose_order,
    energy_order,
    largest_candidate,
)
from tis.patient_side.identification.subspace import check_excitation, check_order
from tis.patient_side.identification.trials import Scaling, Trial, check_trials
from tis.patient_side.identification.validation import HELD_BACK, simulation_fit, split_trials
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace

_NEGLIGIBLE = 1e-10


@dataclass(frozen=True)
class PaperSubspace:
    """U1 (d p, d p), the singular values (d p,) of R22, ``rank`` of them significant, ``R21 R11^-1`` (d p, d m)."""

    left: Array
    singular_values: Array
    rank: int
    response: Array
    n_inputs: int
    n_outputs: int


def paper_subspace(trials: Sequence[Trial], block_rows: int) -> tuple[PaperSubspace, tuple[str, ...]]:
    """Return the listing's LQ and SVD of trials (N, m), (N, p) and a warning when the inputs excite weakly.

    The paper has one trial; the columns of several stand side by side, and none crosses a border. Raises
    `DataError` when the inputs' Hankel matrix is rank-deficient, as R11 is inverted.
    """
    n_inputs, n_outputs = trials[0][0].shape[1], trials[0][1].shape[1]
    past = block_rows * n_inputs
    factor = np.empty((0, block_rows * (n_inputs + n_outputs)))
    for u, y in trials:
        columns = np.vstack([block_hankel(u, block_rows), block_hankel(y, block_rows)])
        factor = np.asarray(np.linalg.qr(np.vstack([factor, columns.T]), mode="r"))
    warnings = check_excitation(factor, past)
    R11, R21, R22 = factor[:past, :past].T, factor[:past, past:].T, factor[past:, past:].T
    left, values, _ = np.linalg.svd(R22)
    rank = int(np.count_nonzero(values > _NEGLIGIBLE * np.linalg.norm(factor[:, past:])))
    response = np.linalg.solve(R11.T, R21.T).T
    return PaperSubspace(left, values, rank, response, n_inputs, n_outputs), warnings


def paper_model(found: PaperSubspace, order: int) -> StateSpace:
    """Return the listing's A, B, C, D for 0 <= ``order`` <= (d - 1) p; A may be unstable.

    Oracles in test_moesp_paper: eigenvalues and Markov parameters of a known system.
    """
    m, p = found.n_inputs, found.n_outputs
    depth = len(found.left) // p
    O_k = found.left[:, :order] * np.sqrt(found.singular_values[:order])
    C = np.ascontiguousarray(O_k[:p])
    A = np.asarray(np.linalg.lstsq(O_k[:-p], O_k[p:])[0]) if order else np.empty((0, 0))

    L1 = found.left[:, order:].T
    M1 = L1 @ found.response
    M = np.vstack([M1[:, k * m : (k + 1) * m] for k in range(depth)])
    L = np.vstack(
        [
            np.hstack([L1[:, k * p : (k + 1) * p], L1[:, (k + 1) * p :] @ O_k[: (depth - 1 - k) * p]])
            for k in range(depth)
        ]
    )
    DB = np.asarray(np.linalg.lstsq(L, M)[0])
    return StateSpace(A, np.ascontiguousarray(DB[p:]), C, np.ascontiguousarray(DB[:p]))


# The paper's empirical Q and R: covariances of the residuals of a first run of its filter.
#
# The four steps of its section "Empirical Estimation of Q and R":
#
# 1. ``Q = epsilon_q I`` and ``R = epsilon_r I``;
# 2. a run of the filter over the training rows, by the paper's prediction and update equations: the measurement is
#    ``z = C x``, without D, and the state is driven by ``u[k-1]``;
# 3. ``r_y[k] = y[k] - C x[k]`` and ``r_x[k] = x[k] - A x[k-1] - B u[k]``, x being the updated estimates;
# 4. ``R = 1/N sum r_y r_y'`` over N rows, ``Q = 1/(N-1) sum r_x r_x'`` over the N - 1 steps, means not removed.
#
# Its r_x takes ``u[k]`` where its own filter takes ``u[k-1]``; that is kept (it changes the root of Q's trace by
# less than 1 % on real trials, with equal epsilons). Values that it leaves open are those of Algorithm 1: x = 0 and
# P = I at the first row, which is not assimilated.


def first_run(space: StateSpace, u: Array, y: Array, epsilon_q: float, epsilon_r: float) -> Array:
    """Return the updated state estimates (N, n) of the first run over inputs (N, m) and outputs (N, p).

    Raises `DataError` where it diverges, as it can with a model of many states that is far from stable. Oracles in
    test_paper_noise: filterpy's filter, and three samples worked by hand.
    """
    from tis.patient_side.filters.kalman import (  # loads filterpy, as in the catalogue
        joseph_update,
        kalman_predict,
    )

    C, n = space.C, space.order
    Q, R = epsilon_q * np.eye(n), epsilon_r * np.eye(space.n_outputs)
    drive = u @ space.B.T
    states, P = np.zeros((len(u), n)), np.eye(n)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(1, len(u)):
            x, P = kalman_predict(states[k - 1], P, space.A, Q, drive[k - 1])
            if not np.all(np.isfinite(P)):
                raise DataError(_diverged(space))
            # Not the gain of `kalman_update`: far from convergence rounding can make the inverted matrix singular.
            K = P @ C.T @ np.linalg.pinv(C @ P @ C.T + R, hermitian=True)
            # Joseph's form of the paper's (I - K C) P, which loses symmetry and then diverges where A is unstable.
            states[k], P = joseph_update(x, P, y[k], C, R, K)
    return states


def _diverged(space: StateSpace) -> Fault:
    rule = f"the first run for Q and R diverges, spectral radius {space.spectral_radius():.4g}: choose a lower order"
    return Fault("identification", "order", rule, space.order)


def empirical_noise(space: StateSpace, trials: Sequence[Trial], epsilon_q: float, epsilon_r: float) -> NoiseModel:
    """Return the paper's empirical Q (n, n) and R (p, p) in the units of the trials; its S is zero.

    The paper has one trial; of several, the sums are pooled, each with its own first run. Raises `DataError` where
    that diverges.
    """
    Q, R = np.zeros((space.order, space.order)), np.zeros((space.n_outputs, space.n_outputs))
    for u, y in trials:
        states = first_run(space, u, y, epsilon_q, epsilon_r)
        r_y = y - states @ space.C.T
        r_x = states[1:] - states[:-1] @ space.A.T - u[1:] @ space.B.T
        R += r_y.T @ r_y
        Q += r_x.T @ r_x
    n_rows = sum(len(u) for u, _ in trials)
    if not (np.all(np.isfinite(Q)) and np.all(np.isfinite(R))):
        raise DataError(_diverged(space))
    Q, R = Q / (n_rows - len(trials)), R / n_rows
    return NoiseModel((Q + Q.T) / 2, (R + R.T) / 2, np.zeros((space.order, space.n_outputs)))


def fit_moesp_paper(training: TrainingSet, identification: Identification) -> Fitted:
    """Return the paper's model of a training set about the lower ends of its ranges; raises `DataError`.

    x0 is zero: the listing estimates none, and its filter starts without one. An unstable A is kept, with a warning.
    R, in metres, is floored at the sensor's resolution, far below the residuals of the paper's run. The validation
    rows serve the report only: the order is the energy rule's on all rows, or the configured one.
    """
    # The listing's subspaces, of all rows and of the first rows.
    block_rows = identification.block_rows
    check_trials(training.trials, block_rows, training.labels, HELD_BACK, past=False)
    scaling = Scaling.by_range(training.trials)
    scaled = scaling.scaled(training.trials)
    fit_on, validate_on = split_trials(scaled)
    found, excitation = paper_subspace(scaled, block_rows)
    found_on_first, _ = paper_subspace(fit_on, block_rows)

    # The order, with all rules for the report.
    n_start = 2 * block_rows
    largest = largest_candidate(found_on_first.rank, block_rows, found.n_outputs)
    candidates = [
        Candidate.of(paper_model(found_on_first, n), [np.zeros(n)] * len(fit_on), fit_on, block_rows)
        for n in range(largest + 1)
    ]
    n_fitted = sum(len(u) for u, _ in fit_on)
    orders = choose_order(candidates, n_fitted, validate_on, found.singular_values, n_start)
    order, cut = _order(found, orders, identification)
    first_rows = paper_model(found_on_first, order)

    # The model of all rows with its noise.
    scaled_space = paper_model(found, order)
    noise = empirical_noise(scaled_space, scaled, identification.epsilon_q, identification.epsilon_r)
    R = scaling.output[:, None] * noise.R * scaling.output
    radius = scaled_space.spectral_radius()
    unstable = (
        f"the paper's model of order {order} is unstable, spectral radius {radius:.6g}, and used as it is:"
        " without measurements it runs away",
    )
    return Fitted(
        space=scaling.unscaled(scaled_space),
        x0=np.zeros(order),
        noise=NoiseModel(noise.Q, floored(R), noise.S),
        singular_values=found.singular_values,
        orders=orders,
        first_rows=scaling.unscaled(first_rows),
        fit=simulation_fit(first_rows, validate_on, n_start),
        n_start=n_start,
        static=False,
        warnings=(*excitation, *cut, *(unstable if radius >= 1 else ())),
    )


def _order(found: PaperSubspace, orders: OrderChoice, identification: Identification) -> tuple[int, tuple[str, ...]]:
    """Return the order, and a warning where a rule requires more states than the block rows can show.

    ``auto`` is the paper's rule, energy. The order is at least one, as its filter needs a state.
    """
    block_rows, rule = identification.block_rows, identification.order
    if isinstance(rule, int):
        check_order(rule, block_rows, found.n_outputs, smallest=1)
        return rule, ()
    if found.rank == 0:
        text = "moesp_paper finds no state: the inputs of the same stretch explain the outputs; use method moesp"
        raise DataError(Fault("identification", "order", text))
    if rule not in ("auto", "energy"):
        return max(1, orders.by_rule(rule)), ()
    wanted, largest = energy_order(found.singular_values), (block_rows - 1) * found.n_outputs
    if wanted <= largest:
        return wanted, ()
    text = f"85 % of the singular values' sum takes {wanted} states, {block_rows} block rows show {largest}: these"
    return largest, (f"{text} are used",)
