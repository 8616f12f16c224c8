"""Driving from pages: their messages, checked like all from outside, the driver's seat and the surgeon's picture."""

import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Annotated, Any, Final

import msgspec
import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    TypeAdapter,
    ValidationError,
)

from tis.common.device_records import TargetRun
from tis.common.units import MM_PER_M, NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.frame import Frame
from tis.deploy.report.subjects.touch import Stability, stability
from tis.deploy.view.device import DeviceDoor, device_pose
from tis.deploy.view.hold_reason import RunAbout, why_hold
from tis.deploy.view.netem_alone import NetemAlone
from tis.deploy.view.page_text import MODES_IN_WORDS
from tis.deploy.view.requests import PageRequest, ask
from tis.deploy.view.steering import Steering
from tis.deploy.watch.arms import Place
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.forces import MJ_PER_J, FeltRow
from tis.deploy.watch.live_figures import LiveFigures
from tis.deploy.watch.observer import Observer

MAX_MESSAGE_CHARS: Final = 400
"""Longest message of a page; the page's own have 120."""

MAX_MOVE_MM: Final = 500.0
_MAX_GRIPPER_RAD: Final = 1.5

Move = Annotated[float, Field(allow_inf_nan=False, ge=-MAX_MOVE_MM, le=MAX_MOVE_MM)]


def _target_run(content: object) -> TargetRun:
    try:
        return msgspec.convert(content, TargetRun)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None


class HandMove(BaseModel):
    """The hand of a page that drives, ``moved_mm`` from where it was when the page took it, in the arm's axes.

    ``target_run`` is the run at the page's targets that has just ended.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    moved_mm: Annotated[list[Move], Field(min_length=3, max_length=3)]
    gripper_rad: Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=_MAX_GRIPPER_RAD)] = 0.0
    clutch: bool = False
    release: bool = False
    target_run: Annotated[TargetRun, PlainValidator(_target_run)] | None = None


def _kind(content: object) -> str:
    return (
        "request" if isinstance(content, PageRequest) or (isinstance(content, dict) and "ask" in content) else "move"
    )


_MESSAGE: Final[TypeAdapter[HandMove | PageRequest]] = TypeAdapter(
    Annotated[
        Annotated[HandMove, Tag("move")] | Annotated[PageRequest, Tag("request")],
        Discriminator(_kind),
    ]
)


def read_message(text: str | bytes) -> HandMove | PageRequest | str:
    """Return a page's message, or in words why it is refused.

    Oracle: messages that break one rule each, tests/deploy/view/test_drive.
    """
    if len(text) > MAX_MESSAGE_CHARS:
        return f"message: must have at most {MAX_MESSAGE_CHARS} characters (got {len(text)})"
    try:
        return _MESSAGE.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        field = ".".join(map(str, first["loc"][1:])) or "message"
        got = repr(first["input"])[:60]
        return f"{field}: {first['msg'][:1].lower()}{first['msg'][1:]} (got {got})"


MAX_RATE_HZ: Final = 100
"""Moves a second that are taken from a page; the page sends 40."""

MAX_DROPPED: Final = 1000
"""Moves beyond that rate after which a page is shown out."""

IDLE_S: Final = 3.0
"""Time without a move after which another page may drive."""

_BURST: Final = 50.0


@dataclass
class Rate:
    """Budget of one page: moves that it may still make (a token bucket), and how many were beyond it."""

    left: float = _BURST
    at_s: float = 0.0
    n_dropped: int = 0

    def takes(self, now_s: float) -> bool:
        """Tell whether one more move is within the rate; count it otherwise."""
        self.left = min(_BURST, self.left + MAX_RATE_HZ * max(now_s - self.at_s, 0.0))
        self.at_s = now_s
        if self.left < 1.0:
            self.n_dropped += 1
            return False
        self.left -= 1.0
        return True


@dataclass
class Seat:
    """Who drives, and the hand. A page that takes the seat moves the hand on from where it is."""

    driver: Hashable | None = None
    hand_mm: Place = (0.0, 0.0, 0.0)
    gripper_rad: float = 0.0
    last_s: float = 0.0
    _base_mm: Place = field(default=(0.0, 0.0, 0.0))

    def drive(self, page: Hashable, move: HandMove, now_s: float) -> bool:
        """Move the hand for a page; False when another page drives. A page that drives no more leaves the seat.

        Oracle: positions added by hand, tests/deploy/view/test_drive.
        """
        if self.driver != page:
            if self.driver is not None and now_s - self.last_s < IDLE_S:
                return False
            self.driver, self._base_mm = page, self.hand_mm
        x, y, z = self._base_mm
        dx, dy, dz = move.moved_mm
        self.hand_mm = (x + dx, y + dy, z + dz)
        self.gripper_rad, self.last_s = move.gripper_rad, now_s
        if move.release:
            self.leave(page)
        return True

    def leave(self, page: Hashable) -> None:
        """Free the seat, if it is this page's; the hand holds."""
        if self.driver == page:
            self.driver = None


OTHER_DRIVES: Final = "another page drives the arm; wait until it lets go, or is not touched for 20 s"
RIVAL: Final = "a device outside this page moves the hand"
NOT_CONNECTED: Final = "the surgeon's network is not there yet, or no more"
NOT_LIVE: Final = "this run plays a movement: only a run with source.kind live, like `tis run live --view`, is driven"

_RIVAL_S: Final = 3.0
_STATE_S: Final = 0.2
_JUDGE_S: Final = 0.5
JUDGED_S: Final = 3.0
_FELT_NS: Final = NS_PER_S


class DriveHub:
    """Moves the hand for one page at a time, and tells all pages what the surgeon sees. Of one thread, the server's.

    A hand that nobody moves is silent: the surgeon's side holds its last pose, logs that and tells it in the report.
    """

    def __init__(
        self, observer: Observer, steering: Steering, door: DeviceDoor | None, about: RunAbout | None = None,
        alone: NetemAlone | None = None,
    ) -> None:  # fmt: skip
        self.seat = Seat()
        self._alone = alone or NetemAlone()
        self._about = about
        self._observer, self._steering, self._door = observer, steering, door
        self._asked_s = self._judged_s = -inf
        self._is_outage = False
        self._figures = LiveFigures()
        self._late_ms: float | None = None
        self._stability: Stability | None = None

    def drive(self, page: Hashable, move: HandMove, now_s: float) -> str:
        """Move the hand for a page; return why not, "" when it moved."""
        if self._door is None:
            return NOT_LIVE
        if self._door.is_rivalled(_RIVAL_S):
            return RIVAL
        if not self.seat.drive(page, move, now_s):
            return OTHER_DRIVES
        seat, device = self.seat, self._door.device
        pose = device_pose(device, seat.hand_mm, seat.gripper_rad, move.clutch, time.monotonic_ns())
        pose = msgspec.structs.replace(pose, target_run=move.target_run)
        return "" if self._door.publish(pose) else NOT_CONNECTED

    def leave(self, page: Hashable) -> None:
        """Free the seat of a page that is gone."""
        self.seat.leave(page)

    def frame(self, now_s: float) -> dict[str, Any]:
        """Return the picture for all pages; positions in mm, null where nothing is known yet."""
        if now_s - self._judged_s >= _JUDGE_S:
            self._judged_s = now_s
            self._figures, rows = self._observer.read(lambda book: (book.figures(JUDGED_S), felt_rows(book)))
            self._stability = stability_of(rows)
        arm = None if self._door is None else self._door.device.arm
        seen, figures, about = self._observer.read(lambda book: picture(book, arm)), self._figures, self._about
        if now_s - self._asked_s >= _STATE_S:
            self._asked_s = now_s
            self._is_outage = self._sees_outage()
            self._late_ms = self._observer.read(lambda book: late_ms(book, seen["arm"]))
        errors, part_ms = figures.display, figures.there_and_back_ms
        return {
            **seen,
            "late_ms": self._late_ms,
            "network_ms": None if part_ms is None else round(part_ms, 1),
            "silent_s": figures.display_silent_s,
            "feedback_error_mm": errors and round(errors.feedback_mm, 2),
            "ghost_error_mm": errors and round(errors.predicted_mm, 2),
            "why": why_hold(figures, about),
            "outage": self._is_outage,
            "network": self._answers(seen["now_s"]),
            "stability": self._stability,
            "moved": None if self._door is None else self.seat.last_s > 0 or self._door.is_rivalled(inf),
            "operator_n_m": about and about.operator_n_m,
            "wall": about and about.wall_mm and {"place_mm": about.wall_mm, "normal": about.wall_normal},
            "left_s": None if about is None else max(0.0, about.duration_s - seen["now_s"]),
        }

    def _answers(self, now_s: float) -> bool:
        """Tell whether the network takes requests: in a run that has begun, or of a netem that runs by itself."""
        if self._alone.is_there:
            return not self._alone.is_over
        return now_s > 0 and "netem" in self._observer.attendance().present

    def ask(self, request: PageRequest, on_answer: Callable[[str], None]) -> None:
        """Do what a page asks of network and arms; ``on_answer`` is called in another thread."""
        ask(self._steering, request, on_answer)

    def _sees_outage(self) -> bool:
        state = self._steering.state()
        ways = () if state is None else (state.forward, state.feedback)
        return any(way is not None and way.outage for way in ways)


def picture(book: LiveBook, arm: str | None) -> dict[str, Any]:
    """Return what is known of an arm (None: the first one that is seen): where hand, feedback and prediction are.

    ``shown_mm`` is the delayed feedback, ``ghost_mm`` the prediction, ``arm_mm`` the arm itself, which nobody at the
    surgeon can see. Oracle: rows made by hand, tests/deploy/view/test_drive.
    """
    shown = [name for name, rows in book.displays.rows.items() if rows.n]
    arm = arm or next(iter([*shown, *sorted(book.newest)]), None)
    if arm is None:
        return {"now_s": book.now_ns / NS_PER_S, "arm": None}
    display = next(iter(book.displays.rows[arm].since(book.displays.rows[arm].n - 1)), None)
    really = next(iter(book.displays.arms[arm].since(book.displays.arms[arm].n - 1)), None)
    newest = book.newest.get(arm, {})
    return {
        "now_s": book.now_ns / NS_PER_S,
        "arm": arm,
        "hand_mm": _mm(newest.get("hand")),
        "estimate_mm": _mm(newest.get("estimate")),
        "shown_mm": _mm(display and display.shown_m),
        "ghost_mm": _mm(display and display.predicted_m),
        "arm_mm": _mm(really and really.arm_m),
        "mode": book.safety.mode(arm),
        "felt": _felt(book.forces.newest.get(arm), book.now_ns),
        "doing": MODES_IN_WORDS.get(book.safety.mode(arm) or ""),
        "stopped": book.is_stopped,
    }


def _felt(row: FeltRow | None, now_ns: int) -> dict[str, Any] | None:
    """Return what a hand feels, on the arm's axes; None without touch, and where nothing newer is known."""
    if row is None or now_ns - row.t_ns > _FELT_NS:
        return None
    return {
        "hand_n": [round(value, 3) for value in row.hand_n],
        "tool_n": row.tool_n and [round(value, 3) for value in row.tool_n],
        "late_ms": None if row.late_ns is None else round(row.late_ns / NS_PER_MS, 1),
        "limited": row.limited,
        "given_mj": round(MJ_PER_J * row.given_j, 2),
        "most_given_mj": round(MJ_PER_J * row.most_given_j, 2),
    }


def felt_rows(book: LiveBook) -> list[FeltRow]:
    """Return what the first hand that feels anything felt over the last seconds."""
    return next((trail.all() for trail in book.forces.rows.values() if trail.n), [])


def stability_of(rows: Sequence[FeltRow]) -> Stability | None:
    """Return how the loop of the last rows stands; None for a device, which tells no intention, and without touch."""
    if len(rows) < 2 or all(row.position_m == row.intended_m for row in rows if any(row.hand_n)):
        return None
    step_ns = float(np.median(np.diff([row.t_ns for row in rows])))
    shown = Frame.of_arrays(
        force_n=np.array([row.hand_n for row in rows]),
        position_m=np.array([row.position_m for row in rows]),
        intended_m=np.array([row.intended_m for row in rows]),
        limited=np.array([row.limited for row in rows]),
    )
    return stability(shown, max(round(NS_PER_S / step_ns), 1))


def late_ms(book: LiveBook, arm: str | None) -> float | None:
    """Return how late the newest display of an arm is; None before the first."""
    rows = None if arm is None else book.displays.rows[arm]
    display = None if rows is None else next(iter(rows.since(rows.n - 1)), None)
    return None if display is None else display.late_ns / NS_PER_MS


def _mm(place_m: Place | None) -> list[float] | None:
    return None if place_m is None else [round(MM_PER_M * value, 3) for value in place_m]
