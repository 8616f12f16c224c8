"""Chains made step by step are found again; the likelihood is the sum over all paths."""

from itertools import product
from math import log

import numpy as np
import pytest
from pydantic import TypeAdapter

from tis.common.scenario.network.loss import Loss
from tis.netem.fit.loss_chain import _Runs, fit_loss_chain, loss_stage


def chain(n: int, p: float, r: float, bad: float, good: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    u, v = rng.random(n), rng.random(n)
    state, lost = 0, np.zeros(n, dtype=bool)
    for i in range(n):
        state = int(u[i] < p) if state == 0 else int(u[i] >= r)
        lost[i] = v[i] < (bad if state else good)
    return lost


def test_the_likelihood_is_the_sum_over_all_paths() -> None:
    lost = np.array([0, 1, 1, 0, 1, 0, 0, 1], dtype=bool)
    p, r, bad, good = 0.2, 0.3, 0.6, 0.1
    steps, shares = np.array([[1 - p, p], [r, 1 - r]]), np.array([r, p]) / (p + r)
    for anew in (None, 3):  # the path begins anew before this message
        total = 0.0
        for path in product((0, 1), repeat=len(lost)):
            chance = shares[path[0]]
            for i, state in enumerate(path):
                of_loss = bad if state else good
                chance *= of_loss if lost[i] else 1 - of_loss
                if i:
                    chance *= shares[state] if i == anew else steps[path[i - 1], state]
            total += chance
        tied = np.arange(1, len(lost)) != anew
        assert _Runs.of(lost, tied).log_likelihood(p, r, bad, good) == pytest.approx(log(total), rel=1e-9)


@pytest.mark.parametrize(
    ("p", "r", "bad", "good"), [(0.001, 0.01, 0.5, 0.001), (0.01, 0.1, 0.5, 0.0), (0.002, 0.02, 0.8, 0.01)]
)
def test_bad_states_that_lose_a_part_are_found(p: float, r: float, bad: float, good: float) -> None:
    lost = chain(30_000, p, r, bad, good, seed=1)
    found = fit_loss_chain(lost)
    assert found is not None
    assert found.p_loss_bad == pytest.approx(bad, abs=0.06)
    assert found.p_good == pytest.approx(r, rel=0.4)
    assert found.p_bad == pytest.approx(p, rel=0.4)
    assert found.p_loss_good == pytest.approx(good, abs=0.002)
    stage = loss_stage(lost)
    assert stage is not None
    assert stage["kind"] == "gilbert_elliott"
    TypeAdapter(Loss).validate_python(stage)


def test_what_is_independent_or_all_lost_in_bursts_gets_no_more_parameters() -> None:
    independent = np.random.default_rng(2).random(15_000) < 0.03
    assert (loss_stage(independent) or {})["kind"] == "bernoulli"
    whole = chain(15_000, 0.01, 0.2, 1.0, 0.0, seed=3)
    assert loss_stage(whole) == {
        "kind": "burst",
        "p_loss": pytest.approx(0.048, rel=0.2),
        "mean_burst": pytest.approx(5, rel=0.1),
    }
    assert loss_stage(np.zeros(100, dtype=bool)) is None


@pytest.mark.parametrize("lost", [[True], [True, False], [True] * 50, [False, True] * 30, [True] * 49 + [False]])
def test_any_record_gets_a_stage_that_a_network_takes(lost: list[bool]) -> None:
    TypeAdapter(Loss).validate_python(loss_stage(np.array(lost)))
