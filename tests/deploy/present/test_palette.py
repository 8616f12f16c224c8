"""Colours: every one can be read or seen on its page, and each estimator keeps its own."""

from typing import get_args

import pytest

from tis.common.channels import Direction
from tis.common.estimators import NAMES
from tis.deploy.present.palette import AXIS, DIRECTIONS, INK, PAPER, RED, SERIES, SOFT, TONES, Tone, look_of


def _luminance(colour: str) -> float:
    """Relative luminance as in WCAG 2.2."""
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def _contrast(one: str, other: str) -> float:
    high, low = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_contrast_is_that_of_wcag() -> None:
    assert _contrast("#000000", "#ffffff") == pytest.approx(21)
    assert _contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("tone", [INK, SOFT, RED])
def test_text_is_read_on_both_pages(tone: Tone) -> None:
    assert _contrast(tone.light, PAPER.light) >= 4.5
    assert _contrast(tone.dark, PAPER.dark) >= 4.5


@pytest.mark.parametrize("tone", [*SERIES, AXIS])
def test_lines_are_seen_on_both_pages(tone: Tone) -> None:
    assert _contrast(tone.light, PAPER.light) >= 3
    assert _contrast(tone.dark, PAPER.dark) >= 3


def test_the_page_can_turn_each_colour_into_the_other_ones_and_back() -> None:
    assert len({tone.light for tone in TONES}) == len({tone.dark for tone in TONES}) == len(TONES)


def test_no_two_estimators_look_alike() -> None:
    names = [*NAMES, "truth", "plant"]
    assert len({look_of(name) for name in names}) == len(names)
    assert look_of("somebody else's") == look_of("another's")


def test_estimators_of_the_users_own_differ_from_each_other_and_from_ours() -> None:
    ours = [*NAMES, "truth", "plant"]
    names = ["truth", "lab:A", "hold", "lab:B", "lab:C", "lab:D", "lab:E", "lab:F", "plant"]
    own = [look_of(name, names) for name in names if ":" in name]
    assert len({*own, *map(look_of, ours)}) == len(own) + len(ours)
    assert [look_of(name, ["lab:A", "lab:B"]) for name in ("lab:A", "lab:B")] == own[:2]


def test_both_directions_have_a_colour() -> None:
    assert set(DIRECTIONS) == set(get_args(Direction))
    assert len(set(DIRECTIONS.values())) == 2
