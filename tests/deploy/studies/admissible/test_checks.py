from collections.abc import Sequence

from tis.deploy.studies.admissible.border import Margins, find_border
from tis.deploy.studies.admissible.region import Place
from tis.deploy.studies.admissible.study import Check, Effort, drawn, most_networks


def test_half_of_the_places_lie_inside_and_half_outside() -> None:
    (region,) = find_border(lambda places: [(x + y - 0.5,) for x, y in places], 2, 1).regions
    places = drawn(region, 20, 2)
    assert len(places.inside) == len(places.outside) == 10
    assert all(x + y <= 0.5 for x, y in places.inside)
    assert all(x + y > 0.47 for x, y in places.outside)
    assert drawn(region, 20, 2) == places
    assert drawn(region, 0, 2) == ([], [])
    assert [len(half) for half in drawn(region, 1, 2)] == [1, 1]


def test_a_whole_box_has_no_place_outside() -> None:
    (region,) = find_border(lambda places: [(-1.0,) for _ in places], 2, 1).regions
    places = drawn(region, 6, 2)
    assert (len(places.inside), places.outside) == (3, [])


def test_an_overlooked_part_is_found_and_warned_of() -> None:
    def two_parts(x: float, y: float) -> float:
        return -1.0 if x + y < 0.4 or (x > 0.5 and y > 0.3) else 1.0

    (region,) = find_border(lambda places: [(two_parts(*place),) for place in places], 2, 1).regions
    places = drawn(region, 40, 2)
    overlooked = sum(two_parts(*place) <= 0 for place in places.outside)
    assert not any(two_parts(*place) > 0 for place in places.inside)
    assert overlooked >= 5
    text = Check(20, 0, 10, overlooked).text
    assert f"{overlooked} of 10 places outside are admissible" in text
    assert "tis compare" in text


def test_few_disagreements_are_no_warning() -> None:
    assert Check(20, 2, 20, 5).text == ""
    assert "3 of 20 places inside are not admissible on fresh seeds" in Check(20, 3, 20, 0).text
    assert Check(0, 0, 0, 0).text == ""


def test_no_search_takes_more_networks_than_are_told() -> None:
    """Borders near both ends of an axis, and bent ones, whose secants crawl."""
    for tolerance in (0.2, 0.02, 0.003):
        for border in (0.001, 0.37, 0.999):
            for bend in (1.0, 9.0, 0.1):
                seen: list[float] = []

                def evaluate(places: Sequence[Place], border: float = border, bend: float = bend) -> list[Margins]:
                    seen.extend(x for (x,) in places)  # noqa: B023
                    return [(x**bend - border**bend,) for (x,) in places]

                find_border(evaluate, 1, 1, tolerance, 150)
                assert len(seen) <= most_networks(1, 1, Effort(tolerance, 150, 0))
    assert most_networks(2, 3, Effort(max_points=150, n_checks=20)) == 8 + 3 * 170
