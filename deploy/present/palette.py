"""Colours of reports and live pages, on light and dark pages, and their assignment to series.

The hues are those of Okabe and Ito (2008), which colour-blind readers can distinguish, darkened where a thin line on
white would be too pale. Contrasts are checked in tests/deploy/present/test_palette.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from tis.common.channels import Direction
from tis.common.estimators import ESTIMATORS, Hue, short_name


@dataclass(frozen=True)
class Tone:
    """One colour on light and on dark pages."""

    light: str
    dark: str


PAPER: Final = Tone("#ffffff", "#161b22")
INK: Final = Tone("#1b1f24", "#e6ebf0")
SOFT: Final = Tone("#4a545e", "#b4bec8")
AXIS: Final = Tone("#8a949e", "#67727d")
GRID: Final = Tone("#e6eaee", "#262e37")
PALE: Final = Tone("#b9c6d3", "#46535f")
BLUE: Final = Tone("#0072b2", "#4aa8e8")
VERMILION: Final = Tone("#d55e00", "#ff8a3d")
GREEN: Final = Tone("#008f68", "#2bc49a")
PINK: Final = Tone("#bf5590", "#e892c0")
BROWN: Final = Tone("#8c6d31", "#cfa85c")
VIOLET: Final = Tone("#7a5195", "#b791d8")
AMBER: Final = Tone("#b07a00", "#f0b43c")
SLATE: Final = Tone("#5b6670", "#98a4b0")
RED: Final = Tone("#c1121f", "#ff6b74")
OUTAGE: Final = Tone("#f6d5d8", "#4d2429")
CHANGED: Final = Tone("#e8e8e9", "#2f363e")
STALL: Final = Tone("#dfe6f3", "#2a3550")
AWAY: Final = Tone("#ece2f5", "#392c47")
STATES: Final = (
    Tone("#e9eef6", "#1f2b3d"),
    Tone("#f4ecd8", "#3a3220"),
    Tone("#e6f0e4", "#22352a"),
    Tone("#efe4ee", "#372a39"),
    Tone("#e2eff1", "#1d3439"),
)
SERIES: Final = (BLUE, VERMILION, GREEN, PINK, BROWN, VIOLET, AMBER, SLATE)
"""Tones of lines, assigned in this order."""

TONES: Final = (PAPER, INK, SOFT, AXIS, GRID, PALE, *SERIES, RED, OUTAGE, STALL, CHANGED, AWAY, *STATES)
"""Every colour of the figures; light ones are unique, as the page's script maps them to dark ones."""

DIRECTIONS: Final[Mapping[Direction, Tone]] = {"forward": BLUE, "feedback": GREEN}
PARTS: Final[Mapping[str, tuple[str, Tone]]] = {
    "surgeon": ("surgeon", VIOLET),
    "network": ("network", BLUE),
    "tick_wait": ("wait for the tick", AMBER),
    "compute": ("compute", GREEN),
    "actuation": ("actuation", PINK),
}
"""Title and colour of each part of the latency, by its name in the summary."""


@dataclass(frozen=True)
class Look:
    """The line style of an estimator or orientation method in all figures: solid, dashed, dotted or dashdot."""

    tone: Tone
    dash: str = "solid"


TRUTH: Final = Look(INK)
_HUES: Final[Mapping[Hue, Tone]] = {
    "BLUE": BLUE,
    "VERMILION": VERMILION,
    "GREEN": GREEN,
    "PINK": PINK,
    "BROWN": BROWN,
    "VIOLET": VIOLET,
    "AMBER": AMBER,
}
_ESTIMATORS: Final[Mapping[str, Look]] = {
    "truth": TRUTH,
    **{name: Look(_HUES[row.hue], row.dash) for name, row in ESTIMATORS.items()},
    "plant": Look(SLATE, "dotted"),
    "tangent_ls": Look(BLUE),
}
_OWN: Final = (
    Look(GREEN, "dashed"),
    Look(BLUE, "dashed"),
    Look(PINK, "dotted"),
    Look(VIOLET, "dotted"),
    Look(BROWN, "dotted"),
    Look(SLATE, "dashed"),
)
"""Styles of user-defined estimators in their order, distinct from those of the testbed's."""


def look_of(estimator: str, among: Sequence[str] = ()) -> Look:
    """Return the line style of an estimator, of ``truth`` and ``plant`` too.

    The testbed's have fixed styles; user-defined ones get theirs by their order ``among`` the names.
    """
    known = _ESTIMATORS.get(short_name(estimator))
    if known is not None:
        return known
    others = [name for name in among if short_name(name) not in _ESTIMATORS]
    return _OWN[others.index(estimator) % len(_OWN) if estimator in others else 0]
