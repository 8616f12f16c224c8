"""The border's search, against shapes whose areas are known, and by properties of all regions."""

from collections.abc import Callable, Sequence
from math import floor, inf, log, nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.deploy.studies.admissible.border import Border, find_border
from tis.deploy.studies.admissible.region import Place

Margin = Callable[..., float]
TOLERANCE = 0.02
DRAWN = np.random.default_rng(2).uniform(size=(1500, 2))


def searched(*margins: Margin, n_axes: int = 2, most: int = 300, tolerance: float = TOLERANCE) -> tuple[Border, int]:
    """The border, and the number of places evaluated; no place twice, and all in the box."""
    seen: list[Place] = []

    def evaluate(places: Sequence[Place]) -> list[tuple[float, ...]]:
        seen.extend(places)
        assert all(0.0 <= share <= 1.0 for place in places for share in place)
        return [tuple(margin(*place) for margin in margins) for place in places]

    border = find_border(evaluate, n_axes, len(margins), tolerance, most)
    assert len(set(seen)) == len(seen) <= most + 2 ** (n_axes + 1)
    return border, len(seen)


def ellipse(x: float, y: float) -> float:
    return log(max(1e-9, (x / 0.8) ** 2 + (y / 0.5) ** 2))


def triangle(x: float, y: float) -> float:
    return x / 0.7 + y / 0.9 - 1


def hyperbola(x: float, y: float) -> float:
    return log((x + 0.05) * (y + 0.05) / 0.1)


def below_a_root(x: float, y: float) -> float:
    """Concave: it reaches far along both axes and little between them."""
    return float(x**0.5 + y**0.5 - 0.9)


def rectangle(x: float, y: float) -> float:
    return -1.0 if x < 0.33 and y < 0.61 else 1.0


def staircase(x: float, y: float) -> float:
    return floor(10 * x) / 10 + y - 0.7


def with_a_bound(x: float, y: float) -> float:
    """Nothing is known beyond the bound, as of a field beyond its largest value."""
    return x + y - 0.6 if x < 0.4 else nan


def from_another_corner(x: float, y: float) -> float:
    return (1 - x) + y - 0.5


AREAS = {
    ellipse: pi / 4 * 0.8 * 0.5,
    triangle: 0.7 * 0.9 / 2,
    hyperbola: 0.1 * (log(1.05**2 / 0.1) + 1) - 0.05 * 2.1 + 0.0025,
    below_a_root: 0.9**4 / 6,
    rectangle: 0.33 * 0.61,
    staircase: sum(0.1 * (0.7 - k / 10) for k in range(7)),
    with_a_bound: 0.4 * 0.6 - 0.4**2 / 2,
    from_another_corner: 0.5**2 / 2,
}


@pytest.mark.parametrize("margin", AREAS)
def test_areas_are_a_little_too_small_and_little_is_too_much(margin: Margin) -> None:
    border, n_places = searched(margin)
    (region,) = border.regions
    assert 0.93 * AREAS[margin] < region.share < AREAS[margin]
    inside = [place for place in DRAWN.tolist() if region.contains(place)]
    assert len(inside) / len(DRAWN) == pytest.approx(region.share, abs=0.03)
    assert sum(not margin(*place) <= 0 for place in inside) / len(inside) < 0.05
    assert border.n_open == (0,)
    assert n_places < 130


@pytest.mark.parametrize(("margin", "share"), [(-1.0, 1.0), (1.0, 0.0), (nan, 0.0), (inf, 0.0), (0.0, 1.0)])
def test_all_or_nothing_takes_few_places(margin: float, share: float) -> None:
    border, n_places = searched(lambda *_: margin)
    assert border.regions[0].share == pytest.approx(share)
    assert border.regions[0].contains((0.3, 0.7)) == (share == 1.0)
    assert n_places <= 13
    assert bool(border.regions[0].border) == (share == 1.0)


@given(st.floats(0.01, 0.99))
def test_an_axis_ends_at_the_crossing(end: float) -> None:
    border, n_places = searched(lambda x: x - end, n_axes=1)
    assert end - TOLERANCE / 2 - 1e-9 <= border.regions[0].share <= end
    assert n_places < 20


def test_a_ball_in_three_axes() -> None:
    border, _ = searched(lambda *place: sum(x * x for x in place) - 0.64, n_axes=3, most=400, tolerance=0.05)
    assert border.regions[0].share == pytest.approx(pi / 6 * 0.8**3, rel=0.1)
    assert border.regions[0].share < pi / 6 * 0.8**3


def test_of_equal_corners_the_one_with_better_neighbours_begins() -> None:
    # The second axis does not matter where the first is 0, and helps elsewhere, as copies do against loss.
    border, _ = searched(lambda x, y: (x - 0.2) * (1.0 - 0.5 * y) if x > 0 else -1.0)
    assert border.regions[0].start == (0.0, 1.0)


def test_estimators_share_rays_and_keep_borders_of_their_own() -> None:
    border, n_places = searched(triangle, ellipse, lambda *_: 1.0)
    alone = [searched(margin) for margin in (triangle, ellipse)]
    assert [region.share for region in border.regions] == pytest.approx([0.315, 0.314, 0.0], rel=0.04)
    assert n_places < sum(n for _, n in alone)


def test_without_enough_places_the_region_is_smaller_and_says_so() -> None:
    border, n_places = searched(ellipse, most=12)
    (region,) = border.regions
    assert n_places == 12 + 4 + 3
    assert border.n_open[0] > 0
    assert 0 < region.share < AREAS[ellipse]
    assert all(ellipse(*place) <= 0 for place in DRAWN.tolist() if region.contains(place))


@settings(max_examples=40, deadline=None)
@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.floats(0.5, 2.5), st.booleans(), st.booleans())
def test_no_convex_region_is_found_too_large(a: float, b: float, power: float, right: bool, top: bool) -> None:
    power = max(power, 1.0)

    def margin(x: float, y: float) -> float:
        x, y = (1 - x if right else x), (1 - y if top else y)
        return float((a * x) ** power + (b * y) ** power - 1)

    border, _ = searched(margin)
    (region,) = border.regions
    assert all(margin(*place) <= 1e-9 for place in DRAWN[:300].tolist() if region.contains(place))
    true = np.mean([margin(*place) <= 0 for place in DRAWN.tolist()])
    assert region.share > true - 0.05
    assert all(margin(*place) <= 0 for place in region.border)
