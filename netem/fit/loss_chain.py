"""The loss model of a record: independent, Gilbert's, or Gilbert and Elliott's with loss below 1 in the bad state."""

from math import log
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.netem.draws.blocks import Floats
from tis.netem.fit.record import rounded

_MIN_LOST: Final = 20
_BEGINNINGS: Final = ((0.3, 3), (0.5, 20), (0.5, 150), (0.9, 20))
"""Loss in the bad state and mean stay there, in messages, from which the search begins: there are several maxima."""

_LOGIT_BOUND: Final = 16.0

Bools = NDArray[np.bool_]


class LossChain(NamedTuple):
    """Gilbert and Elliott's parameters, per message, and the logarithm of their likelihood."""

    p_bad: float
    p_good: float
    p_loss_bad: float
    p_loss_good: float
    log_likelihood: float


def loss_stage(lost: Bools, tied: Bools | None = None) -> dict[str, Any] | None:
    """Return the loss stage with the lowest BIC: ``bernoulli``, ``burst`` or ``gilbert_elliott``; None without loss.

    ``tied`` (N - 1,) is False where messages between two neighbours were taken out: the chain begins anew there.
    """
    n, n_lost = len(lost), int(np.count_nonzero(lost))
    if n_lost == 0:
        return None
    p = n_lost / n
    tied = np.ones(n - 1, dtype=np.bool_) if tied is None else tied
    options = [(_bic(_of_share(n_lost, n), 1, n), {"kind": "bernoulli", "p_loss": rounded(p)})]
    now, then = lost[:-1][tied], lost[1:][tied]
    n_bad, n_good = int(now.sum()), int((~now).sum())
    starts, ends = int((~now & then).sum()), int((now & ~then).sum())
    if n_bad and ends and p < 1:
        gilbert = _of_share(starts, n_good) + _of_share(ends, n_bad) + _of_share(n_lost, n) / n
        burst = max(n_bad / ends, 1.0, p / (1 - p))
        options.append((_bic(gilbert, 2, n), {"kind": "burst", "p_loss": rounded(p), "mean_burst": rounded(burst)}))
    chain = fit_loss_chain(lost, tied)
    if chain is not None:
        options.append((_bic(chain.log_likelihood, 4, n), _stage(chain)))
    return min(options, key=lambda option: option[0])[1]


def fit_loss_chain(lost: Bools, tied: Bools | None = None) -> LossChain | None:
    """Return Gilbert and Elliott's most likely chain; None with fewer than 20 losses or runs.

    The share of losses is a parameter of its own and equal to that of the record. Oracle: known chains, and the sum
    over all paths, tests/netem/fit/test_loss_chain.
    """
    n_lost = int(np.count_nonzero(lost))
    if n_lost < _MIN_LOST or n_lost == len(lost):
        return None
    share = n_lost / len(lost)
    runs = _Runs.of(lost, np.ones(len(lost) - 1, dtype=np.bool_) if tied is None else tied)
    if len(runs.lost) < _MIN_LOST:  # four parameters of a few runs
        return None

    def chain_at(logits: Floats) -> tuple[float, float, float, float]:
        in_bad, part, r = scipy.special.expit(np.clip(logits, -_LOGIT_BOUND, _LOGIT_BOUND))
        p_loss_bad = share + (1 - share) * in_bad
        p_loss_good = share * part
        # the share of time in bad follows from the three loss probabilities
        bad = (share - p_loss_good) / (p_loss_bad - p_loss_good)
        p = min(1.0, r * bad / (1 - bad)) if bad < 1 else 1.0
        return float(p), float(r), float(p_loss_bad), float(p_loss_good)

    def off(logits: Floats) -> float:
        return -runs.log_likelihood(*chain_at(logits))

    best = min(
        (
            scipy.optimize.minimize(
                off,
                scipy.special.logit([(max(h, 1.1 * share) - share) / (1 - share + 1e-9), 0.05, 1 / stay]),
                method="Nelder-Mead",
                options={"xatol": 1e-3, "fatol": 1e-3, "maxiter": 600},
            )
            for h, stay in _BEGINNINGS
            if h < 1
        ),
        key=lambda found: float(found.fun),
    )
    return LossChain(*chain_at(best.x), -float(best.fun))


class _Runs(NamedTuple):
    """Runs of equal fates: which are losses, how long, and which begin behind a gap, arrays (R,)."""

    lost: Bools
    lengths: NDArray[np.int64]
    anew: Bools

    @classmethod
    def of(cls, lost: Bools, tied: Bools) -> "_Runs":
        firsts = np.concatenate([[0], 1 + np.flatnonzero((lost[1:] != lost[:-1]) | ~tied)])
        anew = np.concatenate([[True], ~tied])[firsts]
        return cls(lost[firsts], np.diff(firsts, append=len(lost)), anew)

    def log_likelihood(self, p: float, r: float, p_loss_bad: float, p_loss_good: float) -> float:
        """Return the logarithm of the probability of the runs: a product of powers of 2 x 2 matrices."""
        transition = np.array([[1 - p, p], [r, 1 - r]])
        stationary = np.array([r, p]) / (p + r)
        shown = np.array([[1 - p_loss_good, 1 - p_loss_bad], [p_loss_good, p_loss_bad]])
        matrices, logs = np.empty((len(self.lost), 2, 2)), np.empty(len(self.lost))
        for fate in (0, 1):
            which = self.lost == bool(fate)
            matrices[which], logs[which] = _powers(transition * shown[fate], self.lengths[which])
        # behind a gap the state is drawn anew, whatever it was: a matrix with equal rows
        matrices[self.anew] = np.ones((2, 1)) * (stationary @ matrices[self.anew])[:, None, :]
        total = float(logs.sum())
        while len(matrices) > 1:
            if len(matrices) % 2:
                matrices = np.concatenate([matrices, np.eye(2)[None]])
            matrices = matrices[0::2] @ matrices[1::2]
            scale = np.maximum(matrices.max(axis=(1, 2)), 1e-300)
            matrices /= scale[:, None, None]
            total += float(np.log(scale).sum())
        return total + log(max(float((stationary @ matrices[0]).sum()), 1e-300))


def _powers(matrix: Floats, n: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return powers (R, 2, 2) of a matrix without negative elements, scaled, and the logarithms of the scales.

    By its eigenvalues a >= |b|: M**n = (a**n (M - b) - b**n (M - a)) / (a - b).
    """
    half, gap = (matrix[0, 0] + matrix[1, 1]) / 2, (matrix[0, 0] - matrix[1, 1]) / 2
    root = np.sqrt(gap * gap + matrix[0, 1] * matrix[1, 0])
    a, b = half + root, half - root
    if a <= 0 or a - b < 1e-14:
        return np.broadcast_to(np.full((2, 2), 1e-300), (len(n), 2, 2)), np.zeros(len(n))
    first, second = (matrix - b * np.eye(2)) / (a - b), (matrix - a * np.eye(2)) / (a - b)
    shrink = np.power(b / a, n)[:, None, None]
    return np.maximum(first - shrink * second, 0.0), np.asarray(n * log(a), dtype=np.float64)


def _stage(chain: LossChain) -> dict[str, Any]:
    stage = {
        "kind": "gilbert_elliott",
        "p_bad": max(rounded(chain.p_bad), 1e-9),
        "p_good": max(rounded(chain.p_good), 1e-9),
        "p_loss_bad": rounded(chain.p_loss_bad),
    }
    return stage if chain.p_loss_good < 1e-7 else {**stage, "p_loss_good": rounded(chain.p_loss_good)}


def _of_share(k: int, n: int) -> float:
    """Return the logarithm of the largest likelihood of k events in n trials."""
    return 0.0 if k in (0, n) else k * log(k / n) + (n - k) * log(1 - k / n)


def _bic(log_likelihood: float, n_parameters: int, n: int) -> float:
    return -2 * log_likelihood + n_parameters * log(n)
