"""The picture of the network: each state has its word and colour, and text is no markup."""

import re

import pytest

from tests.deploy.report.outline import Outline
from tis.deploy.present.palette import GREEN
from tis.deploy.report.network_picture import STATES, DirectionFigures, LinkState, network_picture


@pytest.mark.parametrize(
    ("figures", "state"),
    [
        (DirectionFigures(None, None), "unknown"),
        (DirectionFigures(40, 1.2), "good"),
        (DirectionFigures(150, 5), "good"),
        (DirectionFigures(151, 0), "suffering"),
        (DirectionFigures(40, 5.1), "suffering"),
        (DirectionFigures(None, 100), "outage"),
        (DirectionFigures(40, 1, outage_s=0), "outage"),
    ],
)
def test_a_direction_is_in_the_state_that_its_figures_give(figures: DirectionFigures, state: LinkState) -> None:
    assert figures.state == state
    picture = network_picture({"forward": figures}, {})
    assert f"stroke:light-dark({STATES[state].light},{STATES[state].dark})" in picture


def test_it_says_both_directions_to_the_eye_and_to_a_screen_reader() -> None:
    links = {"forward": DirectionFigures(36.62, 1.17), "feedback": DirectionFigures(140.2, 8, outage_s=2.5)}
    picture = network_picture(links, {})  # type: ignore[arg-type]  # keys are literals
    page = Outline(picture)
    (label,) = [given["aria-label"] for given, _ in page.all("svg")]
    for line in ("to the patient: good, median 36.6 ms, 1.17 % lost", "back: outage 2.5 s, median 140 ms, 8 % lost"):
        assert line in label
        assert line in page.text
    assert page.unclosed == []
    assert [text.strip() for _, text in page.all("text")][2:] == ["surgeon", "netem", "patient"]


def test_a_figure_beside_its_limit_shows_on_which_side_it_is() -> None:
    links = {"forward": DirectionFigures(149.6, 5), "feedback": DirectionFigures(150.04, 5.002)}
    picture = network_picture(links, {})  # type: ignore[arg-type]  # keys are literals
    assert "good, median 149.6 ms, 5 % lost" in picture
    assert "suffering, median 150.04 ms, 5.002 % lost" in picture


def test_a_long_line_lies_within_the_picture_and_is_still_readable() -> None:
    worst = DirectionFigures(1234.5, 12.34, outage_s=12.3)
    picture = network_picture({"forward": worst}, {})
    width = int(re.search(r'viewBox="0 0 (\d+)', picture)[1])  # type: ignore[index]
    given, text = Outline(picture).all("text")[0]
    size_px = float(re.search(r"font-size:([\d.]+)px", given["style"])[1])  # type: ignore[index]
    assert 0.54 * size_px * len(text) <= width + 1
    assert 11.5 < size_px < 13


def test_notes_of_the_sides_are_escaped() -> None:
    picture = network_picture({}, {"netem": ("<b>running", GREEN)})
    assert "<b>" not in picture
    assert "&lt;b&gt;running" in picture
