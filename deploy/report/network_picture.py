"""Picture of the network as SVG: surgeon, netem and patient, and between them both directions with their state."""

from dataclasses import dataclass
from html import escape
from typing import Final, Literal

from tis.common.channels import Direction
from tis.deploy.present.page import css
from tis.deploy.present.palette import AMBER, AXIS, GREEN, INK, PAPER, RED, SLATE, SOFT, Tone

LinkState = Literal["good", "suffering", "outage", "unknown"]
STATES: Final[dict[LinkState, Tone]] = {"good": GREEN, "suffering": AMBER, "outage": RED, "unknown": SLATE}
MAX_LOSS_PCT: Final = 5.0
MAX_DELAY_MS: Final = 150.0
"""Loss and median one-way delay above which a direction suffers (ITU-T G.114: 150 ms for conversations)."""

_SIDES: Final = ("surgeon", "netem", "patient")
_WIDTH, _HEIGHT, _BOX, _GAP, _TOP, _BOX_HEIGHT = 372, 148, 92, 47, 42, 64
_WAYS: Final[dict[Direction, tuple[str, int, int]]] = {
    "forward": ("to the patient", _TOP + 20, 18),
    "feedback": ("back", _TOP + 44, _TOP + _BOX_HEIGHT + 22),
}
"""Name, height of the arrows and height of the text of each direction."""

_FONT_PX: Final = 13.0
_LETTER_EM: Final = 0.54
"""Mean width of a letter in the widest of the page's fonts, DejaVu Sans, as a share of its size."""

_DASHES: Final[dict[LinkState, str]] = {"good": "", "suffering": "7 3", "outage": "2 5", "unknown": "1 4"}
_WORDS: Final[dict[LinkState, str]] = {
    "good": "good", "suffering": "suffering", "outage": "outage", "unknown": "not known",
}  # fmt: skip


@dataclass(frozen=True)
class DirectionFigures:
    """Median one-way delay and loss of a direction, None for unknown.

    ``outage_s`` is the length of an outage, 0 for one whose length is not known, None without one.
    """

    delay_ms: float | None
    loss_pct: float | None
    outage_s: float | None = None

    @property
    def state(self) -> LinkState:
        """Return the state: an outage, nothing known, a figure above its limit, or good."""
        if self.outage_s is not None or (self.loss_pct is not None and self.loss_pct >= 100):
            return "outage"
        if self.loss_pct is None:
            return "unknown"
        late = self.delay_ms is not None and self.delay_ms > MAX_DELAY_MS
        return "suffering" if late or self.loss_pct > MAX_LOSS_PCT else "good"


def network_picture(links: dict[Direction, DirectionFigures], notes: dict[str, tuple[str, Tone]]) -> str:
    """Return the picture as markup; ``notes`` are words below the names of the sides, with their colours.

    It is drawn for a width of 372 px, so that text stays readable on a phone, and grows to 560 px.
    """
    drawn = "".join(_way(direction, found) for direction, found in links.items())
    boxes = "".join(_box(i, side, notes.get(side)) for i, side in enumerate(_SIDES))
    spoken = ". ".join(f"{_WAYS[direction][0]}: {_line(found)}" for direction, found in links.items())
    return (
        f'<svg class="network" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
        f'aria-label="{escape(f"Surgeon, netem and patient. {spoken}.")}">{drawn}{boxes}</svg>'
    )


def _way(direction: Direction, found: DirectionFigures) -> str:
    """Return a direction: two arrows through netem, and a line of text."""
    name, y, text_y = _WAYS[direction]
    colour = css(STATES[found.state])
    arrows = "".join(_arrow(_left(i) + _BOX, y, direction == "forward", found.state) for i in (0, 1))
    return (
        f'<g style="stroke:{colour};fill:{colour}">{arrows}</g>'
        f'<text x="{_WIDTH / 2:g}" y="{text_y}" text-anchor="middle" '
        f'style="fill:{css(INK)};font-size:{_size_px(name, found):.3g}px">'
        f'<tspan style="fill:{css(SOFT)}">{escape(name)}:</tspan> '
        f'<tspan style="fill:{colour};font-weight:700">{_WORDS[found.state]}</tspan>'
        f"<tspan>{escape(_figures(found))}</tspan></text>"
    )


def _arrow(x: int, y: int, to_right: bool, state: LinkState) -> str:
    begin, end = (x + 4, x + _GAP - 11) if to_right else (x + _GAP - 4, x + 11)
    tip, back = (x + _GAP - 3, -9) if to_right else (x + 3, 9)
    return (
        f'<line x1="{begin}" y1="{y}" x2="{end}" y2="{y}" style="stroke-width:3;stroke-dasharray:{_DASHES[state]}"/>'
        f'<path d="M{tip} {y}l{back} -6v12z" style="stroke:none"/>'
    )


def _box(place: int, side: str, note: tuple[str, Tone] | None) -> str:
    x, middle = _left(place), _left(place) + _BOX / 2
    name_y = _TOP + (28 if note else 37)
    below = ""
    if note:
        text, tone = note
        below = (
            f' <text x="{middle:g}" y="{name_y + 18}" style="fill:{css(tone)};font-size:12px">{escape(text)}</text>'
        )
    return (
        f'<rect x="{x}" y="{_TOP}" width="{_BOX}" height="{_BOX_HEIGHT}" rx="8" '
        f'style="fill:{css(PAPER)};stroke:{css(AXIS)};stroke-width:1.5"/><g text-anchor="middle">'
        f'<text x="{middle:g}" y="{name_y}" style="fill:{css(INK)};font-weight:700;font-size:14px">'
        f"{escape(side)}</text>"
        f"{below}</g>"
    )


def _size_px(name: str, found: DirectionFigures) -> float:
    """Return the size at which the line of a direction fits: 13 px, less for a long one."""
    n_letters = len(f"{name}: {_line(found)}")
    return min(_FONT_PX, _WIDTH / (_LETTER_EM * n_letters))


def _left(place: int) -> int:
    return 1 + place * (_BOX + _GAP)


def _line(found: DirectionFigures) -> str:
    return f"{_WORDS[found.state]}{_figures(found)}"


def _figures(found: DirectionFigures) -> str:
    """Return what is known: `` 1 s, median 36.6 ms, 1.17 % lost`` after the word for an outage."""
    parts = []
    if found.delay_ms is not None:
        parts.append(f"median {_short(found.delay_ms, MAX_DELAY_MS)} ms")
    if found.loss_pct is not None:
        parts.append(f"{_short(found.loss_pct, MAX_LOSS_PCT)} % lost")
    return (f" {found.outage_s:.3g} s" if found.outage_s else "") + "".join(f", {part}" for part in parts)


def _short(value: float, limit: float) -> str:
    """Return a number in three digits, in more where those would show the limit that it is not."""
    text = f"{value:.0f}" if value >= 100 else f"{value:.3g}" if value >= 1 else f"{value:.2g}"
    more = (f"{value:.{digits}f}" for digits in (1, 2, 3))
    return next(shown for shown in (text, *more, str(value)) if float(shown) != limit or value == limit)
