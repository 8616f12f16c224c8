"""Algorithm 1 of the paper on arrays: a Kalman filter with the network's effects drawn per sample.

The paper is Lashari, Batayneh, Khokhar and Ahmed, "Enhanced Position Estimation in Tactile Internet-Enabled
Remote Robotic Surgery Using MOESP-Based Kalman Filter". Its listing says ``for k = 2..N``::

    del_k <- max(1, k - delay)         y <- lost ? prev_y : PSM[del_k]        prev_y <- y
    x_pred <- A x_est[k-1] + B MTM[k-1]            P_pred <- A P A' + Q
    for each output channel d:
        K <- P_pred C[d]' / (C[d] P_pred C[d]' + R[d])
        x_est[k] <- x_pred + K (y[d] - C[d] x_pred)            P <- (I - K C[d]) P_pred

and ``z_est <- C x_est`` at the end. As printed, every channel starts from x_pred and P_pred again, so that only the
last channel is assimilated; D is dropped; a sample that is ``delay`` old is used as the present one.
"""

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.linear_system import Array, StateSpace


def printed_update(x: Array, P: Array, y: float, c: Array, r: float) -> tuple[Array, Array]:
    """Return the paper's update by one channel ``y = c x`` (c (n,)) of noise variance ``r``.

    Not `kalman_update`: a reproduction rounds, and diverges, as the printed ``(I - K C[d]) P`` does.
    """
    K = P @ c / (c @ P @ c + r)
    return x + K * (y - c @ x), (np.eye(len(c)) - np.outer(K, c)) @ P


def paper_filter(
    mtm: Array,
    psm: Array,
    space: StateSpace,
    Q: Array,
    R: Array,
    delays_samples: NDArray[np.int64],
    lost: NDArray[np.bool_],
    *,
    as_printed: bool,
) -> Array:
    """Return the paper's ``z_est`` (N, p) for commands ``mtm`` (N, m) and measurements ``psm`` (N, p).

    Signals are in the units of ``space``, ``Q`` (n, n) and ``R`` (p, p), about its operating point; of ``R``
    only the diagonal is used. ``delays_samples`` (N,) and ``lost`` (N,) are the paper's
    ``round(nd / dt + randn() nj / dt)`` and ``rand() <= np``, drawn by the caller. With ``as_printed`` the
    update is the listing's; without it x and P are carried from channel to channel, the only difference.

    A negative delay reads a sample of the future, as it does in the paper; beyond the ends the first or the
    last sample is read. The paper leaves three values open; here x_est[1] = 0, P = I, and prev_y begins with the
    first draw's sample, or with C x_est[1] where that is lost. A filter that diverges ends in inf and NaN.

    Oracles: an example worked by hand; for the repaired update, one-shot conditioning of the joint Gaussian.
    """
    A, B, C = space.A, space.B, space.C
    n_samples, n = len(psm), space.order
    # The paper counts samples from 1, arrays from 0: its k is k + 1 here, and its max(1, .) is max(0, .).
    x_est = np.zeros((n_samples, n))
    P = np.eye(n)
    prev_y = C @ x_est[0]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for k in range(n_samples):
            del_k = min(max(0, k - int(delays_samples[k])), n_samples - 1)
            y = prev_y if lost[k] else psm[del_k]
            prev_y = y
            if k == 0:  # the paper's loop begins with the second sample
                continue
            x_pred = A @ x_est[k - 1] + B @ mtm[k - 1]
            P_pred = A @ P @ A.T + Q
            x, P = x_pred, P_pred
            for d in range(len(C)):
                if as_printed:
                    x, P = x_pred, P_pred
                x, P = printed_update(x, P, y[d], C[d], R[d, d])
            x_est[k] = x
        return np.asarray(x_est @ C.T)
