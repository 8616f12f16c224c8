from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.patient_side.identification.known_systems import hand_like, recording, sorted_eigenvalues
from tests.patient_side.identification.test_fit_drmf import few_draws
from tis.common.errors import DataError
from tis.common.estimators import ESTIMATORS
from tis.common.scenario.identification import Identification
from tis.patient_side.identification.companions import FITS, fit_companions
from tis.patient_side.identification.dataset import TrainingSet, training_set
from tis.patient_side.linear_system import StateSpace

__all__ = ["few_draws"]
LAG = StateSpace(0.7 * np.eye(3), 0.15 * np.eye(3), np.eye(3), np.zeros((3, 3)))


FIELDS = ("innovations", "n4sid", "arx", "autoregression", "direct", "paper", "drmf", "wrist")


def fitted(*args: Any) -> SimpleNamespace:
    found = fit_companions(*args)
    return SimpleNamespace(**{field: found.models.get(field) for field in FIELDS}, warnings=found.warnings)


def training(n_rows: int, *, static: bool) -> TrainingSet:
    u = hand_like(n_rows, 1)
    noise = 1e-5 * np.random.default_rng(1).normal(size=u.shape)
    y = 0.5 * u + noise if static else LAG.simulate(u, u[0] / 2) + noise
    return training_set([recording("T", {"left": (u, y + 0.1)})], "left", pool_hands=False)


def test_only_what_is_wanted_is_found(few_draws: None) -> None:
    found = fitted(training(600, static=True), Identification(), ["hold", "direct_ls"])
    assert found.direct is not None
    assert (found.n4sid, found.arx, found.autoregression) == (None, None, None)
    assert fitted(training(600, static=True), Identification(), ["innovations_kf"]).innovations is not None
    assert fitted(training(600, static=True), Identification(), ["drmf"]).drmf is not None
    nothing = fitted(training(600, static=True), Identification(), ())
    assert (nothing.direct, nothing.drmf) == (None, None)


def test_a_gain_has_an_autoregression_and_a_lag_has_none() -> None:
    static = fitted(training(900, static=True), Identification(), ["arx_kf", "n4sid_kf"])
    assert static.arx is not None
    assert static.n4sid is not None
    assert (static.arx.space.order, static.arx.static, static.n4sid.static) == (0, True, True)
    assert static.autoregression is not None
    lagging = fitted(training(900, static=False), Identification(), ["arx_kf", "n4sid_kf"])
    assert lagging.arx is not None
    assert lagging.n4sid is not None
    assert lagging.autoregression is None
    assert sorted_eigenvalues(lagging.n4sid.space.A) == pytest.approx([0.7] * 3, abs=0.02)
    assert lagging.n4sid.output_offset_m == pytest.approx(training(900, static=False).output_offset_m)


def test_what_the_rows_do_not_allow_is_an_error_where_wanted_and_else_a_warning(few_draws: None) -> None:
    short = training(150, static=True)
    with pytest.raises(DataError, match="block rows"):
        fitted(short, Identification(), ["n4sid_kf"])
    found = fitted(short, Identification(), None)
    assert found.n4sid is None
    assert any("no model for n4sid_kf: " in warning for warning in found.warnings)
    assert found.direct is not None


def test_a_user_defined_estimator_gets_all_models_and_wanted_ones_stay_required() -> None:
    found = fitted(training(600, static=True), Identification(), {"hold", "lab:F"})
    assert None not in (found.innovations, found.n4sid, found.arx, found.autoregression, found.direct)
    assert found.drmf is None  # its fit takes seconds
    short = training(150, static=True)
    found = fitted(short, Identification(), {"hold", "lab:F"})
    assert (found.n4sid, found.direct is None) == (None, False)
    assert found.warnings == ()  # nobody asked for n4sid_kf
    with pytest.raises(DataError, match="block rows"):
        fitted(short, Identification(), {"n4sid_kf", "lab:F"})


def test_the_fits_are_those_that_rows_of_estimators_name() -> None:
    assert sorted(fit.__name__ for fit in FITS) == sorted(row.fit for row in ESTIMATORS.values() if row.fit)
