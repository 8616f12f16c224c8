"""Tests of a model's innovations: white, and independent of the inputs, if the model explains what can be explained.

Whiteness by Ljung and Box (1978, Biometrika 65:297), independence by Ljung ("System Identification", 16.6): the
cross-correlations with past inputs, weighed by the inputs' own covariance.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.special import chdtrc

from tis.patient_side.identification.hankel import block_hankel
from tis.patient_side.linear_system import Array

_TWO_SIDED_95 = 1.96


@dataclass(frozen=True)
class ResidualTests:
    """Correlations, the bound that 95 % of those of white residuals keep, and the tests' p-values.

    ``autocorrelation`` (lags, p) begins at lag 1; ``cross_correlation`` (lags + 1, p, m), with inputs that many
    samples before, at lag 0. ``whiteness_p`` (p,) and ``independence_p`` (p,) are the probabilities of statistics as
    large as ``ljung_box`` (p,) and ``input_statistic`` (p,) if the model is right.
    """

    n_rows: int
    autocorrelation: Array
    cross_correlation: Array
    bound: float
    ljung_box: Array
    whiteness_p: Array
    input_statistic: Array
    independence_p: Array

    def passed(self, level: float = 0.01) -> bool:
        """Tell whether no test rejects the model at a level, shared among all tests (Bonferroni)."""
        each = np.concatenate([self.whiteness_p, self.independence_p])
        return bool(np.all(each >= level / len(each)))


def residual_tests(errors: Array, inputs: Array, lags: int) -> ResidualTests:
    """Test innovations (N, p) and inputs (N, m) of one stretch without gaps.

    The degrees of freedom are those of rows that the model was not fitted to: on its training rows the tests reject
    less often than they say. Oracle: rates of rejection over systems that are known, test_residual_tests.
    """
    e, u = errors - errors.mean(axis=0), inputs - inputs.mean(axis=0)
    n, p, m = len(e), e.shape[1], u.shape[1]
    power = np.maximum(np.sum(e**2, axis=0), np.finfo(float).tiny)
    auto = np.array([np.sum(e[k:] * e[:-k], axis=0) / power for k in range(1, lags + 1)])
    ljung_box = n * (n + 2) * np.sum(auto**2 / (n - np.arange(1, lags + 1))[:, None], axis=0)
    # Column k of the Hankel matrix holds the inputs of rows k .. k + lags; its innovation is that of the last.
    past = block_hankel(u, lags + 1)
    now = e[lags:]
    products = past @ now
    own = past @ past.T / len(now)
    variance = power / n
    statistic = np.einsum("ip,ip->p", products, np.linalg.pinv(own, hermitian=True) @ products) / (
        len(now) * variance
    )
    deviation = np.sqrt(np.outer(np.maximum(np.diag(own), np.finfo(float).tiny), variance))
    cross = (products / len(now) / deviation).reshape(lags + 1, m, p)[::-1].transpose(0, 2, 1)
    dependent = chdtrc((lags + 1) * m, statistic) if m else np.ones(p)
    return ResidualTests(
        n, auto, cross, _TWO_SIDED_95 / sqrt(n), ljung_box, chdtrc(lags, ljung_box), statistic, dependent
    )
