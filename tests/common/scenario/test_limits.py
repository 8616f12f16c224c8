import pytest

from common.scenario.limits import PRESETS, Limits


def test_a_preset_fills_in_what_is_not_given() -> None:
    limits = Limits(preset="haptics").resolved()
    assert (limits.end_to_end_p99_ms, limits.loss_max_pct) == (2, 0.1)


def test_ones_own_numbers_win_over_the_preset_even_zero() -> None:
    limits = Limits(preset="augmented_reality", end_to_end_p99_ms=7, loss_max_pct=0).resolved()
    assert (limits.end_to_end_p99_ms, limits.loss_max_pct) == (7, 0)


def test_without_a_preset_nothing_is_added() -> None:
    assert Limits(loss_max_pct=3).resolved() == Limits(loss_max_pct=3)


@pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS)
def test_every_preset_says_where_it_stands(preset: object) -> None:
    assert isinstance(preset, tuple)
    latency_ms, loss_pct, source = preset
    assert latency_ms > 0
    assert loss_pct is None or 0 < loss_pct < 1
    assert len(source) > 20
