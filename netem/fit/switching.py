"""Joint states of delay and loss by a hidden Markov model: an Ornstein-Uhlenbeck process whose law switches.

In each state a share of messages is lost, and the Gaussian scores of the others have a mean and a deviation of their
own; what remains of a score decays with one half-life, whatever the state. So correlated delays alone do not make
states. Hamilton, "A new approach to the economic analysis of nonstationary time series", 1989. States are smoothed by
the forward-backward algorithm (Rabiner, "A tutorial on hidden Markov models", 1989) in blocks, without a loop over
the messages.
"""

from math import isqrt, log, log2
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.units import NS_PER_S
from tis.netem.draws.blocks import Floats
from tis.netem.fit.half_life import gaussian_scores
from tis.netem.fit.loss_chain import Bools
from tis.netem.fit.record import rounded

_MAX_STEPS: Final = 40
_LEAST_STEPS: Final = 2
_SETTLED: Final = 0.5
_MIN_SPREAD: Final = 0.02
_MIN_SHARE: Final = 0.002
_WINDOWS_S: Final = (0.1, 1.0)
_MAX_MESSAGES: Final = 200_000


class Switching(NamedTuple):
    """A fitted model of K states: ``path`` (N,) the likeliest state of each message, the most frequent state first.

    ``transition`` (K, K) is per message, ``scores`` (N,) what remains of the delays' scores in their state, nan where
    lost.
    """

    path: NDArray[np.int64]
    transition: Floats
    p_loss: Floats
    scores: Floats
    log_likelihood: float


class _Seen(NamedTuple):
    """What N messages show: scores y, nan where lost, and the seconds since the last one that arrived."""

    lost: Bools
    y: Floats
    before: NDArray[np.int64]
    since_s: Floats
    tied: Bools


def fit_switching(
    sent_ns: NDArray[np.int64], delay_ns: NDArray[np.int64], tied: Bools, n_states: int
) -> Switching | None:
    """Return the most likely model that is found from several beginnings; None where a state hardly occurs.

    Parameters
    ----------
    sent_ns, delay_ns
        (N,), ``delay_ns`` negative where lost.
    tied
        (N - 1,): False where messages between two neighbours were taken out.
    n_states
        K, 2 or 3.

    Notes
    -----
    By expectation and approximate maximisation: means, deviations and half-life are weighted moments. Oracle: known
    states, tests/netem/fit/test_switching.
    """
    seen = _seen(sent_ns[:_MAX_MESSAGES], delay_ns[:_MAX_MESSAGES], tied[: _MAX_MESSAGES - 1])
    beginnings = _beginnings(seen, sent_ns[:_MAX_MESSAGES], n_states)
    good = [found for weights in beginnings if (found := _climb(seen, weights)) is not None]
    return max(good, key=lambda found: found.log_likelihood) if good else None


def _seen(sent_ns: NDArray[np.int64], delay_ns: NDArray[np.int64], tied: Bools) -> _Seen:
    lost = delay_ns < 0
    y = np.full(len(lost), np.nan)
    y[~lost] = gaussian_scores(delay_ns[~lost])
    latest = np.maximum.accumulate(np.where(lost, -1, np.arange(len(lost))))
    before = np.concatenate([[-1], latest[:-1]])
    since_s = np.where(before >= 0, (sent_ns - sent_ns[before]) / NS_PER_S, np.inf)
    return _Seen(lost, y, before, since_s, tied)


def _beginnings(seen: _Seen, sent_ns: NDArray[np.int64], n_states: int) -> list[Floats]:
    """Return weights (N, K) to begin with: states by the losses, or by the delays, of a short and a long while."""
    interval_s = float(np.median(np.diff(sent_ns))) / NS_PER_S
    found = []
    for window_s in _WINDOWS_S:
        width = max(3, round(window_s / interval_s))
        losses = scipy.ndimage.uniform_filter1d(seen.lost.astype(np.float64), width)
        levels = scipy.ndimage.uniform_filter1d(np.where(seen.lost, 0.0, seen.y), width)
        for value, share in ((losses, float(seen.lost.mean())), (levels, 0.1)):
            cuts = np.quantile(value, 1 - np.array([1.0, 0.3][: n_states - 1]) * max(share, 0.01))
            state = np.searchsorted(np.maximum(np.sort(cuts), 1e-9), value)
            found.append(np.eye(n_states)[state] * 0.96 + 0.04 / n_states)
    return found


def _climb(seen: _Seen, weights: Floats) -> Switching | None:
    """Return the best model on the way from ``weights`` (N, K); moments do not always raise the likelihood."""
    n_states = weights.shape[1]
    transition = np.full((n_states, n_states), 0.01 / (n_states - 1))
    np.fill_diagonal(transition, 0.99)
    steps = weights[:-1, :, None] * weights[1:, None, :]
    best: Switching | None = None
    for step in range(_MAX_STEPS):
        # maximisation: moments, weighted with the posterior
        if weights.mean(axis=0).min() < _MIN_SHARE:
            break
        mean, spread, p_loss = _moments(seen, weights)
        half_life_s = _half_life(seen, steps, mean, spread)
        if step:
            counts = steps[seen.tied].sum(axis=0)
            transition = np.maximum(counts / counts.sum(axis=1, keepdims=True), 1e-9)
        # expectation
        weights, steps, density = smooth(*_densities(seen, transition, mean, spread, p_loss, half_life_s))
        gain = np.inf if best is None else density - best.log_likelihood
        if gain > 0:
            order = np.argsort(-weights.mean(axis=0))
            path = np.argmax(weights[:, order], axis=1)
            scores = (seen.y - mean[order][path]) / spread[order][path]
            best = Switching(path, transition[np.ix_(order, order)], p_loss[order], scores, density)
        if gain < _SETTLED and step > _LEAST_STEPS:
            break
    return best


def _moments(seen: _Seen, weights: Floats) -> tuple[Floats, Floats, Floats]:
    arrived = weights[~seen.lost]
    total = np.maximum(arrived.sum(axis=0), 1e-9)
    y = seen.y[~seen.lost]
    mean = arrived.T @ y / total
    variance = np.array([w @ (y - m) ** 2 for w, m in zip(arrived.T, mean, strict=True)]) / total
    p_loss = weights[seen.lost].sum(axis=0) / weights.sum(axis=0)
    return mean, np.sqrt(np.maximum(variance, _MIN_SPREAD**2)), np.clip(p_loss, 1e-6, 1 - 1e-6)


def _half_life(seen: _Seen, steps: Floats, mean: Floats, spread: Floats) -> float:
    """Return the half-life of what remains of the scores, by the correlation of neighbours that both arrived."""
    next_to = np.flatnonzero(~seen.lost[1:] & ~seen.lost[:-1] & seen.tied) + 1
    x = (seen.y[:, None] - mean) / spread
    rho = float(np.einsum("tij,ti,tj->", steps[next_to - 1], x[next_to - 1], x[next_to]) / max(len(next_to), 1))
    interval_s = float(np.median(seen.since_s[next_to])) if len(next_to) else 1.0
    return interval_s / -log2(min(max(rho, 1e-3), 0.9999))


def _densities(
    seen: _Seen, transition: Floats, mean: Floats, spread: Floats, p_loss: Floats, half_life_s: float
) -> tuple[Floats, Floats]:
    """Return what `smooth` takes: the probability of each state and step times the density of what is seen."""
    rho = np.where(np.isfinite(seen.since_s), 2.0 ** (-seen.since_s / half_life_s), 0.0)
    x = np.nan_to_num((seen.y[:, None] - mean) / spread)
    from_x = np.where(seen.before[:, None] >= 0, x[seen.before], 0.0)
    variance = np.maximum(1 - rho**2, 1e-6)[:, None, None]
    off = x[:, None, :] - rho[:, None, None] * from_x[:, :, None]
    density = np.exp(-0.5 * np.minimum(off**2 / variance, 1400.0)) / (np.sqrt(2 * np.pi * variance) * spread)
    shown = np.where(seen.lost[:, None, None], p_loss, (1 - p_loss) * np.maximum(density, 1e-300))
    stationary = np.linalg.matrix_power(transition, 1 << 30)[0]
    steps = np.where(seen.tied[:, None, None], transition, stationary) * shown[1:]
    return stationary * shown[0].max(axis=0), steps


def successors(transition: Floats, names: list[str], interval_s: float) -> list[dict[str, Any]]:
    """Return duration and succession of each state, as in ``states`` of kind ``markov``."""
    found = []
    for i, row in enumerate(transition):
        leaves = 1.0 - row[i]
        following = [
            {"to": name, "weight": rounded(row[j] / leaves)}
            for j, name in enumerate(names)
            if j != i and row[j] / leaves > 1e-4
        ]
        found.append({"mean_s": rounded(max(interval_s / leaves, 0.001)), "next": following})
    return found


class Smoothed(NamedTuple):
    """Posterior of the states of N messages.

    ``states`` (N, K) are probabilities given the whole record, ``steps`` (N - 1, K, K) those of each pair of
    successive states, ``log_likelihood`` is in nats.
    """

    states: Floats
    steps: Floats
    log_likelihood: float


def smooth(first: Floats, steps: Floats) -> Smoothed:
    """Return the posterior of a chain's states.

    Parameters
    ----------
    first
        (K,): probability of each state at the first message, times the density of what it shows.
    steps
        (N - 1, K, K): probability of each transition to the next message, times the density of what that shows.

    Notes
    -----
    Oracle: enumeration of all paths, tests/netem/fit/test_hidden_markov.
    """
    n_steps, n_states = len(steps), len(first)
    length = max(1, isqrt(max(n_steps, 1)))
    n_blocks = max(1, -(-n_steps // length))
    # Stage 1: blocks of equal length, padded with steps that change nothing; each step scaled to a maximum of 1.
    padded = np.broadcast_to(np.eye(n_states), (n_blocks * length, n_states, n_states)).copy()
    scales = np.maximum(steps.max(axis=(1, 2), initial=0.0), 1e-300)
    padded[:n_steps] = steps / scales[:, None, None]
    blocks = padded.reshape(n_blocks, length, n_states, n_states)
    ahead, behind = np.empty_like(blocks), np.empty_like(blocks)
    logs = np.zeros(n_blocks)
    # Stage 2: the products of the steps up to each place, and of those after it, in all blocks at once.
    product = np.broadcast_to(np.eye(n_states), (n_blocks, n_states, n_states))
    for place in range(length):
        product = product @ blocks[:, place]
        scale = np.maximum(product.max(axis=(1, 2)), 1e-300)
        product = product / scale[:, None, None]
        logs += np.log(scale)
        ahead[:, place] = product
    product = np.broadcast_to(np.eye(n_states), (n_blocks, n_states, n_states))
    for place in range(length - 1, -1, -1):
        behind[:, place] = product
        product = blocks[:, place] @ product
        product = product / np.maximum(product.max(axis=(1, 2)), 1e-300)[:, None, None]
    # Stage 3: from block to block.
    begins, ends = np.empty((n_blocks, n_states)), np.ones((n_blocks, n_states))
    total = log(first.sum()) + float(np.log(scales).sum() + logs.sum())
    state = first / first.sum()
    for number in range(n_blocks):
        begins[number] = state
        state = state @ ahead[number, -1]
        total += log(state.sum())
        state = state / state.sum()
    for number in range(n_blocks - 1, 0, -1):
        before = blocks[number, 0] @ behind[number, 0] @ ends[number]
        ends[number - 1] = before / before.max()
    # Stage 4: the posterior of every message and of every pair.
    forward = np.einsum("bi,btij->btj", begins, ahead).reshape(-1, n_states)[:n_steps]
    forward = np.concatenate([first[None], forward]) if n_steps else first[None]
    forward /= forward.sum(axis=1, keepdims=True)
    backward = np.einsum("btij,bj->bti", behind, ends).reshape(-1, n_states)[:n_steps]
    pairs = forward[:-1, :, None] * padded[:n_steps] * backward[:, None, :]
    pairs /= pairs.sum(axis=(1, 2), keepdims=True)
    states = np.concatenate([pairs.sum(axis=2), pairs[-1:].sum(axis=1)]) if n_steps else forward
    return Smoothed(states, pairs, total)
