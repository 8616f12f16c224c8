"""Driving from pages: their messages, checked like all from outside, the driver's seat and the surgeon's picture."""

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from math import inf
from typing import Annotated, Any, Final

import msgspec
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

from tis.common.device import TargetRun
from tis.common.scenario.control import DirectionState, EmulatorState
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.view.device import DeviceDoor, device_pose
from tis.deploy.view.felt import (
    LoopLimit,
    LoopVerdict,
    NetworkEdges,
    felt_of,
    felt_rows,
    loop_verdict,
    rounded_mm,
    told,
)
from tis.deploy.view.hold_reason import RunAbout, why_hold
from tis.deploy.view.lateness import JUDGED_S, is_frozen, late_ms, network_ms
from tis.deploy.view.netem_alone import NetemAlone
from tis.deploy.view.page_text import MODES_IN_WORDS
from tis.deploy.view.requests import PageRequest, ask
from tis.deploy.view.steering import Steering
from tis.deploy.watch.arms import Place
from tis.deploy.watch.book import LiveBook
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
        self._state: EmulatorState | None = None
        self._limit = LoopLimit(about)
        self._figures = LiveFigures()
        self._late_ms: float | None = None
        self._network_ms: float | None = None
        self._is_frozen = True
        self._edges = NetworkEdges()
        self._loop: LoopVerdict | None = None
        self._n_arm: dict[str, int] = {}

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
            self._loop = loop_verdict(rows, self._edges.changed_ns)
        arm = None if self._door is None else self._door.device.arm
        seen, figures, about = self._observer.read(lambda book: picture(book, arm)), self._figures, self._about
        if now_s - self._asked_s >= _STATE_S:
            self._asked_s = now_s
            self._state = self._steering.state()
            self._edges.note(self._state, round(seen["now_s"] * NS_PER_S))
            self._late_ms, self._network_ms, self._is_frozen = self._observer.read(
                lambda book: (late_ms(book, seen["arm"]), network_ms(book, seen["arm"]), is_frozen(book))
            )
        errors = figures.display
        return {
            **seen,
            "arm_path": self._observer.read(lambda book: self._arm_path(book, seen["arm"])),
            "late_ms": self._late_ms,
            "network_ms": self._network_ms,
            "settles": self._settles(seen["now_s"]),
            "silent_s": figures.display_silent_s,
            "feedback_error_mm": errors and round(errors.feedback_mm, 2),
            "ghost_error_mm": errors and round(errors.predicted_mm, 2),
            "why": why_hold(figures, about),
            "outage": self._sees_outage(),
            "unreached": self._is_cut(),
            "set": set_now(self._state),
            "queues": queues(self._state),
            "network": self._answers(seen["now_s"]),
            "loop": None if self._loop is None else told(self._loop),
            "limit_n_m": self._limit.at(None if self._is_frozen else self._late_ms),
            "wall_n_m": about and about.wall_n_m,
            "moved": None if self._door is None else self.seat.last_s > 0 or self._door.is_rivalled(inf),
            "operator_n_m": about and about.operator_n_m,
            "yields": about is not None and about.is_live and about.simulates_hand,
            "wall": about and about.wall_mm and {"place_mm": about.wall_mm, "normal": about.wall_normal},
            "left_s": None if about is None else max(0.0, about.duration_s - seen["now_s"]),
        }

    def _arm_path(self, book: LiveBook, arm: str | None) -> list[list[float]]:
        """Return where the arm was since the last picture: instants in ms, and places in mm."""
        if arm is None:
            return []
        trail = book.displays.arms[arm]
        rows = trail.since(self._n_arm.get(arm, trail.n))
        self._n_arm[arm] = trail.n
        return [[row.t_ns / NS_PER_MS, *(rounded_mm(row.arm_m) or ())] for row in rows]

    def _answers(self, now_s: float) -> bool:
        """Tell whether the network takes requests: in a run that has begun, or of a netem that runs by itself."""
        if self._alone.is_there:
            return not self._alone.is_over
        return now_s > 0 and "netem" in self._observer.attendance().present

    def ask(self, request: PageRequest, on_answer: Callable[[str], None]) -> None:
        """Do what a page asks of network and arms; ``on_answer`` is called in another thread."""
        ask(self._steering, request, on_answer)

    def _is_cut(self) -> bool:
        """Tell whether the hand's moves do not reach the arm now."""
        return self._state is not None and self._state.forward is not None and self._state.forward.outage

    def _settles(self, now_s: float) -> bool:
        """Tell whether pictures of before the last change of the network are among those of the last seconds."""
        since_s = now_s - self._edges.changed_ns / NS_PER_S
        return self._edges.changed_ns > 0 and since_s < JUDGED_S + (self._late_ms or 0.0) * NS_PER_MS / NS_PER_S

    def _sees_outage(self) -> bool:
        ways = () if self._state is None else (self._state.forward, self._state.feedback)
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
        "hand_mm": rounded_mm(newest.get("hand")),
        "estimate_mm": rounded_mm(newest.get("estimate")),
        "shown_mm": rounded_mm(display and display.shown_m),
        "ghost_mm": rounded_mm(display and display.predicted_m),
        "arm_mm": rounded_mm(really and really.arm_m),
        "mode": book.safety.mode(arm),
        "felt": felt_of(book.forces.newest.get(arm), book.now_ns),
        "doing": MODES_IN_WORDS.get(book.safety.mode(arm) or ""),
        "stopped": book.is_stopped,
    }


def queues(state: EmulatorState | None) -> bool:
    """Tell whether messages wait in a queue beside the delay that is set."""
    ways = () if state is None else (state.forward, state.feedback)
    return any(way is not None and way.now.rate is not None for way in ways)


def set_now(state: EmulatorState | None) -> dict[str, Any]:
    """Return what netem is set to, there and back, in the units of the page's fields: delay in ms, loss in percent.

    ``at_s`` is when the newest change that holds was requested to act. None is what no single number tells, and what
    is not known. Oracle: states by hand, tests/deploy/view/test_drive.
    """
    ways = (None, None) if state is None else (state.forward, state.feedback)

    def of(way: DirectionState | None, stage: str, name: str, per_unit: float) -> float | None:
        if way is None:
            return None
        found = getattr(way.now, stage)
        value = 0.0 if found is None else getattr(found, name, None)
        return None if value is None else round(per_unit * value, 6)

    added = [one.at_s for way in ways if way is not None for one in way.added]
    return {
        "at_s": max(added, default=None),
        "delay": [of(way, "delay", "delay_ms", 1.0) for way in ways],
        "loss": [of(way, "loss", "p_loss", 100.0) for way in ways],
    }
