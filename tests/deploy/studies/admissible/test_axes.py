import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tis.common.errors import InputError
from tis.deploy.studies.admissible.region import MAX_AXES, Axis, axis_faults, parse_axis, whole_fault


@pytest.mark.parametrize(
    ("text", "axis"),
    [
        ("network.forward.delay.delay_ms=0..500", Axis("network.forward.delay.delay_ms", 0.0, 500.0)),
        ("a.b=1e-3..1:log", Axis("a.b", 0.001, 1.0, log=True)),
        ("a.b=-5..5", Axis("a.b", -5.0, 5.0)),
    ],
)
def test_axes_are_read(text: str, axis: Axis) -> None:
    assert parse_axis(text) == axis


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("a.b=5..5", "empty or reversed"),
        ("a.b=5..1", "empty or reversed"),
        ("a.b=0..1:log", "needs numbers above 0"),
        ("a.b=x..1", "must read a.b=FIRST..LAST"),
        ("a.b=0..inf", "must read a.b=FIRST..LAST"),
        ("a.b=0..1:5", "must read a.b=FIRST..LAST"),
        ("a..b=0..1", "must read a.b=FIRST..LAST"),
        ("0..1", "must read a.b=FIRST..LAST"),
    ],
)
def test_other_texts_are_refused(text: str, rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        parse_axis(text)


def test_axes_that_cannot_vary_together_are_named() -> None:
    axis = Axis("a.b", 0.0, 1.0)
    assert "must name each field once" in str(axis_faults((axis, axis))[0])
    assert "cannot be varied" in str(axis_faults((Axis("seed", 0.0, 1.0),))[0])
    assert "is required" in str(axis_faults(())[0])
    assert axis_faults((axis, Axis("a.c", 0.0, 1.0))) == []


@given(st.floats(1e-3, 1e3), st.floats(1.01, 1e3), st.booleans(), st.floats(0.0, 1.0))
def test_a_share_and_its_value_belong_together(first: float, ratio: float, log: bool, share: float) -> None:
    axis = Axis("a", first, first * ratio, log)
    assert axis.value(0.0) == axis.first
    assert axis.value(1.0) == axis.last
    assert axis.share(axis.value(share)) == pytest.approx(share, abs=1e-5)
    assert isinstance(yaml.safe_load(axis.text(share)), int | float)
    assert float(axis.text(share)) == axis.value(share)


def test_whole_numbers_are_the_nearest_ones() -> None:
    axis = Axis("surgeon.copies", 1.0, 4.0, whole=True)
    assert [axis.text(share) for share in (0.0, 0.1, 0.2, 0.5, 0.6, 1.0)] == ["1", "1", "2", "2", "3", "4"]


def test_integers_run_between_integers_and_few_fields_vary_at_once() -> None:
    assert whole_fault(Axis("surgeon.copies", 1.0, 4.0, whole=True)) is None
    assert whole_fault(Axis("a", 0.5, 3.7)) is None
    assert "integers only" in str(whole_fault(Axis("surgeon.copies", 1.0, 3.7, whole=True)))
    axes = tuple(Axis(f"a{i}", 0.0, 1.0) for i in range(MAX_AXES + 1))
    assert axis_faults(axes[:-1]) == []
    assert f"at most {MAX_AXES} fields" in str(axis_faults(axes)[0])
