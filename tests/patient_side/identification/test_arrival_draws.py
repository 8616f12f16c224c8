import numpy as np

from tis.patient_side.identification.fit_drmf import arrival_draws


def test_each_draw_has_its_age_and_arrivals_are_lost_and_late() -> None:
    draws = arrival_draws([400, 60], (1, 6, 20), 100, 50, "a")
    assert [draw.ahead for draw in draws] == [1] * 100 + [6] * 100 + [20] * 100
    for draw in draws:
        assert draw.ahead + 8 <= draw.row < (400, 60)[draw.trial]
        assert draw.arrived[draw.ahead]
        assert not draw.arrived[: draw.ahead].any()
    # Loss alone, as in the first of two draws, takes 15 % in the mean; lateness takes recent ones besides.
    late = np.array([draw.arrived[draw.ahead + 1 : draw.ahead + 16] for draw in draws])
    assert 0.12 < 1 - late[::2].mean() < 0.18
    assert 1 - late[1::2].mean() > 0.3
    old = np.array([draw.arrived[draw.ahead + 16 : draw.ahead + 30] for draw in draws])
    assert 0.12 < 1 - old.mean() < 0.18


def test_the_same_label_draws_the_same() -> None:
    one, other, third = (arrival_draws([200], (3,), 20, 30, label) for label in ("a", "a", "b"))
    assert [draw.row for draw in one] == [draw.row for draw in other] != [draw.row for draw in third]
    assert all(np.array_equal(x.arrived, y.arrived) for x, y in zip(one, other, strict=True))


def test_horizons_that_no_trial_is_long_enough_for_have_no_draws() -> None:
    assert {draw.ahead for draw in arrival_draws([30], (3, 21, 22, 60), 5, 70, "a")} == {3, 21}


def test_a_window_holds_what_has_arrived_relative_to_the_newest() -> None:
    y = np.outer(np.arange(100.0), [1.0, 2.0, 3.0])
    draw = next(draw for draw in arrival_draws([100], (4,), 50, 40, "a") if 20 < draw.row < 35)
    path, known = draw.window(y, 40, draw.row)
    for place in range(40):
        row = draw.row - 39 + place
        expected = row >= 0 and draw.arrived[39 - place]
        assert known[place] == expected
        assert np.array_equal(path[place], y[row] - y[draw.row - 4] if expected else np.zeros(3))
    # One that ends earlier knows the same samples.
    assert np.array_equal(draw.window(y, 10, draw.row - 2)[1], known[28:38])
