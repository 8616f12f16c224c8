"""Numbers and times as people say them."""

import pytest

from tis.deploy.present.numbers import rounded_count, rounded_span, significant
from tis.deploy.report.subjects.requirements import limit_text, needed_count, needed_time


@pytest.mark.parametrize(
    ("n", "said"),
    [
        (0, "0"),
        (299, "299"),
        (999, "999"),
        (2995, "3000"),
        (123_456, "120000"),
        (999_999, "1 million"),
        (29_957_322, "30 million"),
        (1_260_000, "1.3 million"),
        (2_995_732_272, "3 billion"),
    ],
)
def test_a_count_has_two_digits_from_a_thousand_on(n: int, said: str) -> None:
    assert rounded_count(n) == said


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.4, "0.4 s"),
        (30, "30 s"),
        (90, "1.5 min"),
        (4.2 * 3600, "4.2 h"),
        (5.8 * 86400, "5.8 days"),
        (400 * 86400, "1.1 years"),
        (4e5 * 365.25 * 86400, "400000 years"),
    ],
)
def test_a_time_has_its_largest_unit(seconds: float, said: str) -> None:
    assert rounded_span(seconds) == said


def test_the_rate_is_that_of_what_was_met() -> None:
    assert needed_count(29_957_322, "loss") == "about 30 million messages"
    assert needed_count(60, "rmse_3d") == "about 60 ticks"
    assert needed_time(36_000, 600, 20.0) == ", 20 min at this rate"
    assert needed_time(36_000, 600, None) == needed_time(36_000, 0, 20.0) == ""


@pytest.mark.parametrize(
    ("value", "said"),
    [(0, "0"), (1e-5, "0.00001"), (0.1234, "0.123"), (69.04, "69"), (999.7, "1000"), (29_957.4, "29957")],
)
def test_a_number_is_plain(value: float, said: str) -> None:
    assert significant(value) == said


def test_a_limit_is_said_as_it_was_given() -> None:
    assert limit_text(33.333, "ms") == "allowed 33.333 ms"
    assert limit_text(1e-5, "%") == "allowed 0.00001 %"
