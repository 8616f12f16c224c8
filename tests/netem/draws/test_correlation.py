from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from tis.common.scenario.network.delay import Correlation
from tis.common.streams import BLOCK, Address
from tis.netem.draws.correlation import ScorePath, bridge_of, uniforms

ADDRESS = Address(3, "forward", "tis/MTML/measured_cp")
LEVEL_1 = BLOCK  # blocks in a block of the next coarser grid


def _path(
    half_life_s: float, address: Address = ADDRESS, stage: str = "delay", across_keys: bool = False
) -> ScorePath:
    return ScorePath(Correlation(half_life_s=half_life_s, across_keys=across_keys), address, stage)


def _scores(half_life_s: float, n_blocks: int) -> NDArray[np.float64]:
    path = _path(half_life_s)
    return np.concatenate([path.block(number) for number in range(n_blocks)])


@pytest.mark.parametrize("half_life_s", [0.05, 0.25])
def test_the_autocorrelation_halves_with_each_half_life(half_life_s: float) -> None:
    z = _scores(half_life_s, 1500)  # 6.1 million cells
    cells = round(half_life_s * 1000)
    for n_half_lives in (1, 2):
        lag = n_half_lives * cells
        assert np.mean(z[lag:] * z[:-lag]) / np.mean(z * z) == pytest.approx(0.5**n_half_lives, abs=0.02)
    assert z.mean() == pytest.approx(0, abs=4 * np.sqrt(2 * cells / np.log(2) / len(z)))
    assert z.var() == pytest.approx(1, abs=4 * np.sqrt(2 * cells / np.log(2) / len(z)))


@pytest.mark.parametrize("shared", [0.0, 0.3, 0.8, 1.0])
def test_the_share_is_the_correlation_of_the_two_directions(shared: float) -> None:
    part = Correlation(half_life_s=0.05, shared=shared)
    one, other = (
        np.concatenate([ScorePath(part, address, "delay").block(number) for number in range(400)])
        for address in (ADDRESS, Address(3, "feedback", "tis/PSM2/measured_cp"))
    )
    within = 4 * np.sqrt(2 * 50 / np.log(2) / len(one))
    assert np.mean(one * other) == pytest.approx(shared, abs=within)
    for z in (one, other):
        assert (z.mean(), z.var()) == (pytest.approx(0, abs=within), pytest.approx(1, abs=within))
        assert np.mean(z[50:] * z[:-50]) == pytest.approx(0.5, abs=within)


@pytest.mark.parametrize("half_life_s", [0.02, 4.096, 60.0])
def test_nothing_shows_where_blocks_meet(half_life_s: float) -> None:
    a = 2 ** (-0.001 / half_life_s)
    path = _path(half_life_s)
    numbers = [*range(400), *range(LEVEL_1 - 100, LEVEL_1 + 100)]
    blocks = {number: path.block(number) for number in numbers}
    steps = [blocks[second][0] - a * blocks[first][-1] for first, second in pairwise(numbers) if second == first + 1]
    fresh = np.array(steps) / np.sqrt(1 - a * a)
    assert stats.kstest(fresh, "norm").pvalue > 0.001
    at_edge = abs(blocks[LEVEL_1][0] - a * blocks[LEVEL_1 - 1][-1]) / np.sqrt(1 - a * a)
    assert at_edge < 5


def test_long_half_lives_join_distant_blocks() -> None:
    # an hour's half-life: over 68 s, 17 blocks, the correlation falls to 2^(-69.632 / 3600) = 0.987
    firsts = []
    for key in range(120):
        path = _path(3600.0, ADDRESS._replace(key=f"k{key}"))
        firsts.append((path.block(LEVEL_1 - 9)[0], path.block(LEVEL_1 + 8)[0]))
    before, after = np.array(firsts).T
    rho = 2 ** (-17 * 4.096 / 3600)
    assert ((after - rho * before) / np.sqrt(1 - rho**2)).std() == pytest.approx(1, abs=4 / np.sqrt(240))
    assert stats.kstest(before, "norm").pvalue > 0.001


@settings(deadline=None, max_examples=40)
@given(
    numbers=st.lists(
        st.one_of(st.integers(0, 3), st.integers(LEVEL_1 - 2, LEVEL_1 + 2), st.integers(0, 10**9)),
        min_size=1,
        max_size=6,
    )
)
def test_a_block_is_the_same_whatever_was_asked_before(numbers: list[int]) -> None:
    path = _path(0.7)
    for number in numbers:
        assert path.block(number).tobytes() == _path(0.7).block(number).tobytes()


def test_a_path_is_that_of_its_stage_and_key_alone() -> None:
    one = _path(0.1).block(5)
    assert abs(np.corrcoef(one, _path(0.1, stage="jitter").block(5))[0, 1]) < 0.5
    other = Address(3, "forward", "tis/PSM2/setpoint_cp")
    assert not np.array_equal(one, _path(0.1, other).block(5))
    assert not np.array_equal(one, _path(0.1, ADDRESS._replace(seed=4)).block(5))
    shared = _path(0.1, across_keys=True).block(5)
    assert np.array_equal(shared, _path(0.1, other, across_keys=True).block(5))
    assert not np.array_equal(shared, _path(0.1, ADDRESS._replace(direction="feedback"), across_keys=True).block(5))
    assert not np.array_equal(shared, one)


@pytest.mark.parametrize(("half_life_s", "level"), [(0.003, 0), (86_400.0, 0), (30.0, 1)])
def test_the_bridge_is_what_conditioning_on_both_ends_gives(half_life_s: float, level: int) -> None:
    bridge = bridge_of(half_life_s, level)
    points = np.array([1, 2, 700, 2048, 4090, 4095])
    # one-shot Gaussian conditioning of these points on the two ends
    at = np.concatenate([[0, BLOCK], points]) * (float(BLOCK) ** level * 1e-3)
    rate = np.log(2) / half_life_s
    covariance = np.exp(-rate * np.abs(at[:, None] - at[None, :]))
    # 1 - rho^2 by expm1: the ends of a short stretch of a slow process are nearly equal
    rho, rest = covariance[0, 1], -np.expm1(-2 * rate * at[1])
    inverse = np.array([[1, -rho], [-rho, 1]]) / rest
    gain = covariance[2:, :2] @ inverse
    ends = np.array([0.7, -1.3])
    mean = bridge.between(np.zeros(BLOCK), *ends)
    np.testing.assert_allclose(mean[points], gain @ ends, atol=1e-7)
    assert mean[0] == ends[0]
    left, right = at[2:], at[1] - at[2:]
    expected = -np.expm1(-2 * rate * left) * np.expm1(-2 * rate * right) / np.expm1(-2 * rate * at[1])
    # the bridge is linear in its normals: the columns of that map give its variance
    variance = np.zeros(len(points))
    for column in range(BLOCK):
        unit = np.zeros(BLOCK)
        unit[column] = 1.0
        variance += bridge.between(unit, 0.0, 0.0)[points] ** 2
    np.testing.assert_allclose(variance, expected, rtol=1e-7)


def test_uniforms_keep_to_the_open_interval() -> None:
    u = uniforms(np.array([-40.0, -8.0, 0.0, 40.0]))
    assert 0 < u[0] <= u[1] == pytest.approx(6.22e-16, rel=0.01)
    assert u[2] == 0.5
    assert u[3] < 1
