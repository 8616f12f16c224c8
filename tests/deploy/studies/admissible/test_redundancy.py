import pytest

from tis.deploy.studies.admissible.profiles import Price, Redundancy, redundancies


def cost(one: Redundancy) -> tuple[int, int]:
    """Packets and bytes of a sample, with the sizes that scenarios are checked by."""
    return one.copies, one.copies * (20 + 250 * (1 + one.history))


@pytest.mark.parametrize("price", ["bytes", "packets"])
def test_redundancies_come_cheapest_first(price: Price) -> None:
    found = redundancies(30, 1, 4, price)
    costs = [cost(one) if price == "packets" else cost(one)[::-1] for one in found]
    assert costs == sorted(costs)
    assert len(set(found)) == len(found) == 8
    assert {one.copies for one in found} == {1, 2, 3, 4}
    assert all((one.history > 0) == (one.copies == 1) for one in found)
    assert all((one.copies - 1) * one.spacing_ms < 1000 / 30 for one in found)


def test_they_set_all_fields_and_read_well() -> None:
    spread = Redundancy(3, 11.1, 0)
    assert spread.settings == {"surgeon.copies": "3", "surgeon.copy_spacing_ms": "11.1", "surgeon.history": "0"}
    assert [one.text for one in (spread, Redundancy(2, 0.0, 0), Redundancy(1, 0.0, 4))] == [
        "3 copies 11.1 ms apart",
        "2 copies",
        "history 4",
    ]
    assert redundancies(30, 1, 1, "bytes") == [Redundancy(1, 0.0, 1), Redundancy(1, 0.0, 4)]
