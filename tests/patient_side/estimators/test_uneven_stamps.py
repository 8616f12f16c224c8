"""A device whose stamps lie beside the plan's instants: its estimates err hardly more than those of an even one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.patient_side.arm_models import static_model
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import synthesise
from tis.common.units import NS_PER_S, sample_instant_ns
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.identification.fit_innovations import fit_innovations
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

RATE_HZ, FINER = 50, 10
N_TRAIN, N = 1000, 400
LATES = np.random.default_rng(1).integers(-3, 4, N) / FINER


@cache
def path() -> Array:
    """The arm at ten times the rate, without noise: as hard a case as there is."""
    source = SyntheticSource(kind="synthetic", hands=("left",), recorder_hz=None)
    return synthesise(source, 5, FINER * RATE_HZ, FINER * (N_TRAIN + N + 20), 0).hands[0].follower.position_m


@cache
def model() -> ArmModel:
    rows = path()[: FINER * N_TRAIN : FINER]
    found = fit_innovations([(rows, rows)], RATE_HZ, 5, order=9).model
    return replace(static_model(), rate_hz=RATE_HZ, innovations=replace(found, correction=None))


def error_mm(lates: Array, told: Array, lost: NDArray[np.bool_], delay_ns: int) -> float:
    """The RMSE where samples are taken ``lates`` periods after the plan's instants, and stamped as ``told``."""
    estimator, playout, done, errors = InnovationsKf(model()), Playout(RATE_HZ), 0, []
    state = estimator.initial()
    first = FINER * N_TRAIN
    for k in range(N):
        now_ns = sample_instant_ns(k, RATE_HZ) + NS_PER_S // RATE_HZ // 2
        while done < N and sample_instant_ns(done, RATE_HZ) + playout.periods_ns(lates[done]) + delay_ns <= now_ns:
            if not lost[done]:
                taken_m = path()[first + FINER * done + round(FINER * lates[done])]
                playout.arm.add(done, taken_m, late=float(told[done]))
            done += 1
        state, estimate = estimator.step(state, playout, now_ns)
        if k > 100 and estimate.position_m is not None:
            errors.append(estimate.position_m - path()[first + FINER * k + FINER // 2])
    return float(1000 * np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))


@pytest.mark.parametrize("p_lost", [0.0, 0.2])
def test_an_uneven_device_errs_as_an_even_one_with_the_same_gaps(p_lost: float) -> None:
    even, lost = np.zeros(N), np.random.default_rng(2).random(N) < p_lost
    for delay_ns in (100_000_000, 200_000_000):
        least = error_mm(even, even, lost, delay_ns)
        assert error_mm(LATES, LATES, lost, delay_ns) < 1.03 * least
        assert error_mm(LATES, even, lost, delay_ns) > 1.2 * least  # as it was before stamps counted
