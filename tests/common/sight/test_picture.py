"""The drawn picture and its stamps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.scenario.sight import CELL
from tis.common.sight.picture import Scene, Tools, draw, scene_of, seen_rows
from tis.common.sight.stamp import Picture, Stamp, band_rows, draw_stamps, read_stamps
from tis.deploy.run.resolve import resolve

SCENE = Scene(320, 240, 150, yields=True)
HERE: Tools = ((100, 120), None)


@given(st.integers(0, 2**32 - 1), st.integers(-1, 2**32 - 2), st.sampled_from([320, 336, 640, 1920]))
def test_stamps_are_read_as_they_were_drawn(frame: int, command: int, width: int) -> None:
    picture = np.zeros((240, width, 3), dtype=np.uint8)
    draw_stamps(picture, Stamp(frame, command))
    assert read_stamps(picture) == (Stamp(frame, command),) * 2
    assert band_rows(width) % CELL == 0


@pytest.mark.parametrize("size", [(641, 480), (810, 601), (16, 2816)])
def test_stamps_are_drawn_and_read_in_pictures_of_any_width(size: tuple[int, int]) -> None:
    picture = np.zeros((size[1], size[0], 3), dtype=np.uint8)
    draw_stamps(picture, Stamp(3, 4))
    assert read_stamps(picture) == (Stamp(3, 4),) * 2


@pytest.mark.parametrize("size", [(15, 900), (640, 90), (16, 2815)])
def test_a_picture_without_room_has_no_stamps(size: tuple[int, int]) -> None:
    picture = np.zeros((size[1], size[0], 3), dtype=np.uint8)
    assert read_stamps(picture) == (None, None)
    with pytest.raises(ValueError, match="has at least 16 columns"):
        draw_stamps(picture, Stamp(3, 4))


def test_a_damaged_stamp_and_one_in_the_others_place_are_unreadable() -> None:
    picture = draw(SCENE, Stamp(7, 3), [HERE])
    rows = band_rows(320)
    swapped = picture.copy()
    swapped[:rows], swapped[-rows:] = picture[-rows:], picture[:rows]
    assert read_stamps(swapped) == (None, None)
    picture[:CELL, 4 * CELL : 5 * CELL] = 255 - picture[:CELL, 4 * CELL : 5 * CELL]
    assert read_stamps(picture) == (None, Stamp(7, 3))
    assert read_stamps(np.full((240, 320, 3), 128, dtype=np.uint8)) == (None, None)


def _colours(picture: Picture) -> set[tuple[int, ...]]:
    return {tuple(one) for one in picture[seen_rows(SCENE)].reshape(-1, 3).tolist()}


def test_the_tool_dents_what_it_touches_and_leaves_a_path() -> None:
    above = draw(SCENE, Stamp(0, 0), [HERE])
    pressed = draw(SCENE, Stamp(0, 0), [((100, 190), None)])
    sky = tuple(above[100, 300].tolist())
    assert tuple(above[160, 100].tolist()) != sky
    assert tuple(pressed[152, 112].tolist()) == sky
    stiff = draw(Scene(320, 240, 150, yields=False), Stamp(0, 0), [((100, 190), None)])
    assert tuple(stiff[152, 112].tolist()) != sky
    moved = draw(SCENE, Stamp(0, 0), [((250, 100), None), HERE])
    assert len(_colours(moved)) == len(_colours(above)) + 1


@pytest.mark.parametrize("at", [(-16384, -16384), (16384, 16384), (-5, 239), (319, 0)])
def test_arms_outside_the_picture_are_no_fault(at: tuple[int, int]) -> None:
    assert draw(SCENE, Stamp(0, -1), [(at, at), (None, (0, 0)), (at, None)]).shape == (240, 320, 3)


def test_a_metre_is_four_thousand_pixels_and_up_is_up() -> None:
    assert SCENE.pixel((0.01, 5.0, 0.02), (0.0, 0.0, 0.0), 160) == (200, 96 - 80)
    assert SCENE.pixel((1e6, 0, -1e6), (0.0, 0.0, 0.0), 160) == (16384, 16384)
    assert scene_of(resolve("touch_and_sight", (), None, None)) == Scene(640, 480, 192 + 8, yields=True)
    assert scene_of(resolve("sight", (), None, None)) == Scene(640, 480, 384, yields=False)


@pytest.mark.parametrize(
    ("normal", "right"), [((0.0, 0.0, 2.0), 0), ((1.0, 0.0, 0.0), 1), ((0.0, -1.0, 0.0), 0), ((1.0, 1.0, 1.0), None)]
)
def test_the_surface_is_drawn_where_the_arm_touches_it(normal: tuple[float, float, float], right: int | None) -> None:
    settings = (f"touch.environment={{kind: wall, normal: {list(normal)}, distance_mm: 5}}",)
    scene = scene_of(resolve("touch_and_sight", settings, None, None))
    up, first_m = np.array(normal) / np.linalg.norm(normal), np.array([0.3, -0.2, 0.1])
    assert scene.pixel(tuple(first_m - 0.005 * up), tuple(first_m), 320) == (320, scene.surface)
    assert scene.pixel(tuple(first_m + 0.010 * up), tuple(first_m), 320) == (320, scene.horizon - 40)
    if right is not None:
        assert scene.pixel(tuple(first_m + 0.01 * np.eye(3)[right]), tuple(first_m), 320) == (360, scene.horizon)


def test_a_surface_through_a_point_is_drawn_there_wherever_the_arm_began() -> None:
    settings = ("touch.environment={kind: wall, normal: [0, 1, 0], position_mm: [10, 20, 30]}",)
    scene = scene_of(resolve("touch_and_sight", settings, None, None))
    for first_m in ((0.0, 0.0, 0.0), (0.1, 0.05, -0.2)):
        assert scene.pixel((first_m[0], 0.02, 7.0), first_m, 320) == (320, scene.surface)
        assert scene.pixel((first_m[0] + 0.01, 0.03, 0.0), first_m, 320) == (360, scene.surface - 40)
