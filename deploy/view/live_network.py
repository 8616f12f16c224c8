"""The network on the live page: state of the three sides and of both directions, as a picture."""

from typing import Final, get_args

from common.channels import Direction, Side
from common.scenario.control import EmulatorState
from deploy.report.page.network_picture import DirectionFigures, network_picture
from deploy.report.palette import AMBER, GREEN, RED, SLATE, Tone
from deploy.view.page_text import PageContext
from deploy.watch.live_figures import LiveFigures
from deploy.watch.observer import Attendance
from deploy.watch.watched_streams import StreamName

_STREAMS: Final[dict[Direction, StreamName]] = {"forward": "arm", "feedback": "answers"}


def network_html(
    attendance: Attendance, now_s: float, context: PageContext, found: LiveFigures, state: EmulatorState | None
) -> str:
    """Return the picture of the sides and of both directions, with the figures of the last seconds."""
    links = {direction: _direction(direction, found, state) for direction in get_args(Direction)}
    return network_picture(links, {side: _side(side, attendance, now_s, context) for side in get_args(Side)})


def _direction(direction: Direction, found: LiveFigures, state: EmulatorState | None) -> DirectionFigures:
    """Return the figures of the arm's samples or of the estimates on their way back, and netem's outage."""
    seen = found.streams.get(_STREAMS[direction])
    now = None if state is None else getattr(state, direction)
    outage_s = 0.0 if now is not None and now.outage else None
    if seen is None:
        return DirectionFigures(None, None, outage_s)
    return DirectionFigures(seen.delay_p50_ms, seen.loss_pct, outage_s)


def _side(side: Side, attendance: Attendance, now_s: float, context: PageContext) -> tuple[str, Tone]:
    """Return the state of a side in words, and its colour."""
    if "netem" in attendance.left:
        return "has ended", SLATE
    if side in attendance.left:
        return "has left", RED
    if side in attendance.present:
        return "running" if now_s > 0 else "ready", GREEN
    return "starting" if context.beside else "not there yet", AMBER
