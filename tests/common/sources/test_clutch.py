import numpy as np
import pytest

from tis.common.sources.hand_movements import minimum_jerk
from tis.common.sources.synthetic import EASE_S, PRESSED_S, Clutch
from tis.common.sources.trajectory import Array
from tis.common.streams import Stream

TWO = Clutch(np.array([1.0, 4.0]))


def rate(t_s: Array) -> Array:
    """Return how fast work goes: 1, down to 0 in 0.3 s, 0 for 1 s, up to 1 in 0.3 s."""
    going = np.ones_like(t_s)
    for onset_s in TWO.onset_s:
        ease_off = minimum_jerk((t_s - onset_s) / 0.3)
        going = going - ease_off + minimum_jerk((t_s - onset_s - 1.3) / 0.3)
    return going


def test_working_time_is_its_rate_integrated() -> None:
    assert (EASE_S, PRESSED_S) == (0.3, 1.0)
    t_s = np.linspace(0.0, 8.0, 80_001)
    middle_s = (t_s[1:] + t_s[:-1]) / 2
    expected_s = np.concatenate([[0.0], np.cumsum(rate(middle_s) * np.diff(t_s))])
    assert np.abs(TWO.working_s(t_s) - expected_s).max() < 1e-6
    assert TWO.working_s(np.array([-0.5, 0.5, 8.0])) == pytest.approx([-0.5, 0.5, 8.0 - 2 * 1.3])
    assert np.diff(TWO.working_s(t_s)).min() > -1e-12


def test_a_master_moves_only_while_the_pedal_is_pressed() -> None:
    stream = Stream.named(1, "clutch")
    t_s = np.linspace(0.0, 8.0, 8001)
    moved_mm = TWO.moved_mm(stream, t_s)
    moving = np.any(np.abs(np.diff(moved_mm, axis=0)) > 1e-9, axis=1)
    pressed = ((t_s > 1.2995) & (t_s < 2.3005)) | ((t_s > 4.2995) & (t_s < 5.3005))
    assert not moving[~pressed[1:]].any()
    assert moving[pressed[1:]].mean() > 0.95
    assert np.all(moved_mm[t_s < 1.2995] == 0)
    assert 1 < np.abs(moved_mm).max() <= 40


@pytest.mark.parametrize("per_min", [0.5, 4.0, 30.0])
def test_the_pedal_is_pressed_as_often_as_asked(per_min: float) -> None:
    n_min = 600 / per_min
    clutch = Clutch.pressed(per_min, Stream.named(2, "pressed"), 60 * n_min)
    assert np.sum(clutch.onset_s < 60 * n_min) == pytest.approx(600, rel=0.15)
    assert np.diff(clutch.onset_s).min() >= 1.6 - 1e-9
    assert clutch.onset_s[-1] > 60 * n_min
    sooner = Clutch.pressed(per_min, Stream.named(2, "pressed"), 1.0)
    assert np.array_equal(sooner.onset_s, clutch.onset_s[: len(sooner.onset_s)])
