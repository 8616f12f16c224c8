import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.errors import InputError
from tis.deploy.compare.grid import Sweep, axis_words, grid_faults, parse_sweep, points_of

A, B = Sweep("a.x", ("1", "2")), Sweep("b", ("u", "v", "w"))


@given(first=st.floats(0.1, 50), last=st.floats(60, 5000), count=st.integers(2, 40), log=st.booleans())
def test_a_range_is_evenly_spaced_or_of_equal_ratios(first: float, last: float, count: int, log: bool) -> None:
    sweep = parse_sweep(f"a.b={first}..{last}:{count}{':log' if log else ''}")
    values = np.array([float(value) for value in sweep.values])
    assert (len(values), sweep.path) == (count, "a.b")
    steps = np.diff(np.log(values) if log else values)
    assert steps == pytest.approx(np.full(count - 1, steps.mean()), rel=1e-2)
    assert (values[0], values[-1]) == (pytest.approx(first, rel=1e-5), pytest.approx(last, rel=1e-5))


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("network.forward.delay.delay_ms", "delay to the patient, ms"),
        ("network.feedback.delay.mean_ms", "delay mean back, ms"),
        ("network.forward.loss.p_loss", "probability of loss to the patient"),
        ("surgeon.copies", "surgeon copies"),
        ("network.profile", "profile"),
        ("rate_hz", "rate, Hz"),
    ],
)
def test_an_axis_has_words(path: str, words: str) -> None:
    assert axis_words(path) == words


def test_ranges_and_values_go_together() -> None:
    assert parse_sweep("a=0..500:3, 700").values == ("0", "250", "500", "700")
    assert parse_sweep("a=1..1000:4:log").values == ("1", "10", "100", "1000")
    assert parse_sweep("a=-1..1:3").values == ("-1", "0", "1")
    assert parse_sweep("a=1000000..1000010:3").values == ("1000000", "1000005", "1000010")
    assert parse_sweep("a=0..0.00001:3").values == ("0", "0.000005", "0.00001")


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("a=0..x:3", "between two numbers"),
        ("a=0..5:1", "2 to 10000 values"),
        ("a=0..5:99999", "2 to 10000 values"),
        ("a=0..5:3:log", "above 0"),
        ("a=0..5", ""),
        ("a=1,1", "different values"),
        ("a", "different values"),
        ("=1", "different values"),
        ("a=0..1:2,1", "different values"),
    ],
)
def test_a_sweep_that_is_none_is_refused_by_its_rule(text: str, rule: str) -> None:
    if not rule:
        assert parse_sweep(text).values == ("0..5",)  # the scenario says whether that is a value
        return
    with pytest.raises(InputError, match=rule):
        parse_sweep(text)


def test_points_are_the_product_or_side_by_side() -> None:
    points = points_of((A, B), zipped=False)
    assert [point.label for point in points] == ["1, u", "1, v", "1, w", "2, u", "2, v", "2, w"]
    assert points[4].settings == ("a.x=2", "b=v")
    zipped = points_of((A, Sweep("b", ("u", "v"))), zipped=True)
    assert [point.values for point in zipped] == [{"a.x": "1", "b": "u"}, {"a.x": "2", "b": "v"}]
    (nothing,) = points_of((), zipped=False)
    assert (nothing.label, nothing.settings) == (None, ())


def test_faults_of_a_grid_come_before_its_points() -> None:
    assert grid_faults((A, B), zipped=False) == []
    (twice,) = grid_faults((A, A), zipped=False)
    assert "must name each field once (got 'a.x')" in str(twice)
    (uneven,) = grid_faults((A, B), zipped=True)
    assert "equally many values" in str(uneven)
    (seeds,) = grid_faults((Sweep("seed", ("1", "2")),), zipped=False)
    assert "--seeds takes several (got 'seed')" in str(seeds)
    thousand = tuple(Sweep(name, tuple(map(str, range(1000)))) for name in "abc")
    (many,) = grid_faults(thousand, zipped=False)
    assert "at most 100,000 combinations" in str(many)
    assert "1,000,000,000" in str(many)
