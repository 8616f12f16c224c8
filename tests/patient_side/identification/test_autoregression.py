import numpy as np
import pytest

from tis.patient_side.identification.arx import ArxFactor
from tis.patient_side.identification.fit_innovations import autoregression, fit_autoregression, schwarz_lags
from tis.patient_side.linear_system import Array


def process(n_rows: int, seed: int) -> Array:
    """Return three channels (N, 3), in m, of one second-order process each, with poles 0.9 +- 0.2i."""
    e, y = 1e-4 * np.random.default_rng(seed).normal(size=(n_rows, 3)), np.zeros((n_rows, 3))
    for k in range(2, n_rows):
        y[k] = 1.8 * y[k - 1] - 0.85 * y[k - 2] + e[k]
    return y


def factor_of(y: Array, largest: int) -> ArxFactor:
    return ArxFactor.of([(y[:, :0], y)], largest)


def test_schwarz_finds_the_number_of_lags() -> None:
    assert schwarz_lags(factor_of(process(4000, 0), 8), 8) == 2


def test_the_model_is_that_of_the_process() -> None:
    outputs = [process(n, n) for n in (2000, 60, 2500)]
    model = fit_autoregression([(y[:, :0], y) for y in outputs], 30, 6)
    assert model.order == 6
    assert np.hstack([model.C @ model.K, model.C @ model.A @ model.K]) == pytest.approx(
        np.hstack([1.8 * np.eye(3), (1.8**2 - 0.85) * np.eye(3)]), abs=0.08
    )
    assert pytest.approx(1e-8 * np.eye(3), abs=6e-10) == model.Re
    assert np.all((model.covariance_scale > 0.6) & (model.covariance_scale < 1.6))


def test_an_unstable_autoregression_has_all_its_poles_drawn_in_alike() -> None:
    y = np.zeros((60, 1))
    for k in range(2, 60):
        y[k] = 1.6 * y[k - 1] - 0.56 * y[k - 2] + (1.0 if k == 2 else 0.0)
    y[2:] *= (1.02 ** np.arange(58))[:, None]  # poles 0.8 and 0.8 x 0.875, times 1.02: still stable
    stable = autoregression(factor_of(y, 2), 2)
    grown = autoregression(factor_of(y * (1.3 ** np.arange(60))[:, None], 2), 2)
    before, after = np.sort(np.linalg.eigvals(stable.A)), np.sort(np.linalg.eigvals(grown.A))
    assert after[-1] == pytest.approx(0.999)
    assert after / after[-1] == pytest.approx(before / before[-1], rel=1e-6)
    assert np.linalg.eigvals(grown.A - grown.K @ grown.C) == pytest.approx([0, 0], abs=1e-6)
