"""Numbers as text, against literals."""

import pytest

from tis.deploy.present import numbers


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"),
        (7, "7"),
        (0.0, "0"),
        (-0.0, "0"),
        (0.00049, "0.0005"),
        (-0.000021, "-0.00002"),
        (1e-13, "0.000"),
        (0.12345, "0.123"),
        (1.2345, "1.23"),
        (123.4, "123.4"),
        (1234.6, "1235"),
        (99.9999, "99.999"),
    ],
)
def test_significant_digits(value: float | None, text: str) -> None:
    assert numbers.number(value) == text


def test_a_noun_is_in_the_plural_unless_it_is_one() -> None:
    assert [numbers.counted(n, "run") for n in (0, 1, 2)] == ["0 runs", "1 run", "2 runs"]


def test_values_of_cells() -> None:
    assert [numbers.shown(value) for value in ("x", None, True, False, 2, 2.5)] == [
        "x",
        "-",
        "yes",
        "no",
        "2",
        "2.50",
    ]


def test_a_diverged_filter_has_a_power_of_ten() -> None:
    assert [numbers.fixed(value, 2) for value in (None, 1.005, 2e4, -3.21e7)] == ["-", "1.00", "2e+04", "-3e+07"]
    assert numbers.per_axis([1.0, None, 1e5]) == "1.00 - 1e+05"


def test_percent() -> None:
    assert [numbers.percent(value) for value in (None, 0.123, 0.0123)] == ["-", "12", "1"]
    assert [numbers.percent(value) for value in (0.0, 0.00125, 0.0094, 0.0096)] == ["0", "0.1", "0.9", "1"]
    assert [numbers.percent(value, fine=True) for value in (None, 0.123, 0.0123)] == ["-", "12", "1.2"]


def test_intervals() -> None:
    assert numbers.interval([1.0, 2.0]) == "1.00 to 2.00"
    assert numbers.interval(None) == numbers.interval([None, 1.0]) == "-"
    assert numbers.with_interval(0.8, (0.7, 0.9)) == "0.800 (0.700-0.900)"
    assert numbers.with_interval(0.8, (None, None)) == "0.800"
    assert numbers.with_interval(None, (0.7, 0.9)) == "-"
