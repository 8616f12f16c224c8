"""Smoothing in a hidden Markov chain: the forward-backward algorithm in blocks, without a loop over the messages.

Rabiner, "A tutorial on hidden Markov models", 1989. The products of the transition matrices of a block are computed
for all blocks side by side; only the block's ends are passed on one by one.
"""

from math import isqrt, log
from typing import NamedTuple

import numpy as np

from tis.netem.draws.blocks import Floats


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
