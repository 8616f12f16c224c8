"""The camera's picture, drawn in integers so that it is the same on every machine: tissue, path and tool of each arm.

The camera looks along the surface of what is touched: down the rows is into it. It stands still, centred on where
each arm was first, or, where a point of the surface is given, on that height.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario import Scenario
from tis.common.sight.stamp import Picture, Stamp, band_rows, draw_stamps
from tis.common.vector import Vector, dot, minus

Pixel = tuple[int, int]
"""Column and row of a tool's tip."""

Pixels = NDArray[np.int64]

Tools = tuple[Pixel | None, Pixel | None]
"""The tips of the left and the right hand's arm."""

PATH_FRAMES: Final = 45
"""Frames of which the path is drawn, the present one among them."""

PIXELS_PER_M: Final = 4000.0
_SKY: Final = (52, 30, 34)
_TISSUE: Final = (168, 74, 72)
_TOOLS: Final = ((214, 218, 224), (150, 186, 226))
_PATHS: Final = ((240, 200, 90), (110, 220, 170))
_DENT: Final = 48
_FAR: Final = 1 << 14
_ACROSS_X: Final = 0.9


@dataclass(frozen=True)
class Scene:
    """What stands still: the picture's size, and the row of the tissue's surface; ``yields``: it is touched.

    ``right`` and ``up`` are the picture's directions in the frame of the arm's positions. ``at_m`` is a point of the
    surface; None: the surface is as far from each arm's first position as its row from the `horizon`.
    """

    width: int
    height: int
    surface: int
    yields: bool
    right: Vector = (1.0, 0.0, 0.0)
    up: Vector = (0.0, 0.0, 1.0)
    at_m: Vector | None = None

    @property
    def horizon(self) -> int:
        """Return the row at which arms begin."""
        return self.height * 2 // 5

    def pixel(self, at_m: Vector, first_m: Vector, column: int) -> Pixel:
        """Return where a position is seen, of an arm that was at ``first_m`` first, in that ``column``."""
        row, begun_m = (self.horizon, first_m) if self.at_m is None else (self.surface, self.at_m)
        x = round(PIXELS_PER_M * dot(self.right, minus(at_m, first_m)))
        y = round(PIXELS_PER_M * dot(self.up, minus(begun_m, at_m)))
        return min(max(column + x, -_FAR), _FAR), min(max(row + y, -_FAR), _FAR)


def scene_of(scenario: Scenario) -> Scene:
    """Return the scene of a scenario with sight: what its arms touch, or tissue out of reach."""
    assert scenario.sight is not None
    width, height = scenario.sight.width, scenario.sight.height
    if scenario.touch is None:
        return Scene(width, height, height * 4 // 5, yields=False)
    environment = scenario.touch.environment
    right, up = _axes(environment.normal)
    if environment.position_mm is not None:
        x, y, z = (each / 1000.0 for each in environment.position_mm)
        return Scene(width, height, height * 3 // 5, True, right, up, (x, y, z))
    down = round(PIXELS_PER_M * environment.distance_m)
    return Scene(width, height, min(max(height * 2 // 5 + down, 0), height), True, right, up)


def _axes(normal: Vector) -> tuple[Vector, Vector]:
    """Return the directions right and up of a camera that looks along a plane with this normal.

    Right is x where that lies in the plane, and what is left of it where it nearly does; of a plane across x it is y.
    """
    up = np.array(normal) / np.linalg.norm(normal)
    right = np.eye(3)[0 if abs(up[0]) < _ACROSS_X else 1]
    right = right - right.dot(up) * up
    (a, b, c), (x, y, z) = (right / np.linalg.norm(right)).tolist(), up.tolist()
    return (a, b, c), (x, y, z)


def draw(scene: Scene, stamp: Stamp, path: Sequence[Tools]) -> Picture:
    """Return the picture; ``path`` has the tools of up to `PATH_FRAMES` frames, the present one last."""
    picture = _background(scene, path[-1])
    for hand in (0, 1):
        tips = [tip for tools in path[-PATH_FRAMES:] if (tip := tools[hand]) is not None]
        lines = [_line(one, other) for one, other in pairwise(tips)]
        if lines:
            _paint(picture, np.concatenate(lines), _DOT, _PATHS[hand])
    for tip, colour in zip(path[-1], _TOOLS, strict=True):
        if tip is not None:
            shaft = _line((tip[0] + (scene.height - tip[1]) // 6, min(tip[1], -1)), tip)
            _paint(picture, shaft, _ACROSS, colour)
            _paint(picture, np.array([tip]), _BALL, colour)
    draw_stamps(picture, stamp)
    return picture


@cache
def _still(scene: Scene) -> tuple[Picture, Picture]:
    """Return the picture without any tissue, and one of tissue alone; its grain is something to encode."""
    columns, rows = np.arange(scene.width), np.arange(scene.height)[:, None]
    grain = ((columns // 8 * 7 + rows // 8 * 13) % 23)[:, :, None]
    empty = np.broadcast_to(np.array(_SKY, dtype=np.uint8), (scene.height, scene.width, 3))
    return empty, (np.array(_TISSUE) + grain).astype(np.uint8)


def _background(scene: Scene, tools: Tools) -> Picture:
    empty, tissue = _still(scene)
    picture = empty.copy()
    picture[scene.surface :] = tissue[scene.surface :]
    for tip in tools if scene.yields else ():
        if tip is None or tip[1] <= scene.surface:
            continue
        # a dent as deep as the tip, with straight flanks
        low, high = max(tip[0] - _DENT, 0), min(tip[0] + _DENT, scene.width)
        columns = np.arange(low, max(low, high))
        depth = (tip[1] - scene.surface) * (_DENT - np.abs(columns - tip[0])) // _DENT
        rows = np.arange(scene.surface, min(tip[1], scene.height))[:, None]
        y, x = np.nonzero(rows < scene.surface + depth)
        picture[y + scene.surface, x + low] = _SKY
    return picture


def _line(begin: Pixel, end: Pixel) -> Pixels:
    """Return the pixels (N, 2) of a line, its end among them."""
    (x0, y0), (x1, y1) = begin, end
    n = max(abs(x1 - x0), abs(y1 - y0), 1)
    steps = np.arange(1, n + 1, dtype=np.int64)
    return np.stack((x0 + (x1 - x0) * steps // n, y0 + (y1 - y0) * steps // n), axis=1)


def _disc(half: int) -> Pixels:
    across, down = np.mgrid[-half : half + 1, -half : half + 1].reshape(2, -1)
    return np.stack((across, down), axis=1)[np.flatnonzero(across * across + down * down <= half * half + 1)]


_DOT: Final = _disc(1)
_BALL: Final = _disc(9)
_ACROSS: Final = np.stack((np.arange(-5, 6), np.zeros(11, dtype=np.int64)), axis=1)


def _paint(picture: Picture, at: Pixels, brush: Pixels, colour: tuple[int, int, int]) -> None:
    """Paint a brush at pixels, as far as they lie in the picture."""
    x, y = (at[:, None, :] + brush).reshape(-1, 2).T
    height, width, _ = picture.shape
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    picture[y[inside], x[inside]] = colour


def seen_rows(scene: Scene) -> slice:
    """Return the rows between the stamps, of which the quality of a picture is measured."""
    rows = band_rows(scene.width)
    return slice(rows, scene.height - rows)
