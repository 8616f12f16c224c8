"""Forces of touch as an observer of the surgeon's network sees them: what came back, and what the hand is shown."""

from math import dist, sqrt
from typing import Final, NamedTuple

from msgspec import DecodeError

from tis.common.channels import FOLLOWER, hand_channels
from tis.common.messages import ShownForce, Vector3, Wrench, decode
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.watch.arms import Place, Trail

MJ_PER_J: Final = 1000.0
_MAX_ROWS: Final = 1500
_ROWS_EVERY_NS: Final = 10 * NS_PER_MS
_MAX_AHEAD_NS: Final = 10 * NS_PER_S
_MAX_SHOWN_N: Final = 1000.0
"""Largest force that a scenario lets a hand feel."""
_MAX_TOOL_N: Final = 10_000.0
_MAX_STEP_M: Final = 1.0
"""A hand that is further from its last place than that has not moved there: no energy is counted."""


class FeltRow(NamedTuple):
    """What a hand feels at a tick of the surgeon, on the arm's axes; ``tool_n`` is the newest force that came back.

    ``late_ns`` is the time since that force acted on the tool, ``put_in_j`` the energy that the hand has put into the
    coupling so far, less what it got, as far as the observer saw it: the report's sign.
    """

    t_ns: int
    hand_n: Place
    tool_n: Place | None
    late_ns: int | None
    limited: str
    position_m: Place
    intended_m: Place
    put_in_j: float
    most_given_j: float


class Forces:
    """The forces of a session by arm, some hundred rows a second. Not thread-safe; rows are bounded."""

    def __init__(self, session: str) -> None:
        self.rows: dict[str, Trail[FeltRow]] = {arm: Trail(_MAX_ROWS) for arm in FOLLOWER.values()}
        self.newest: dict[str, FeltRow] = {}
        self._tool: dict[str, Wrench] = {}
        rows = [(arm, hand_channels(hand, arm)) for hand, arm in FOLLOWER.items()]
        self._back = {row.force.key(session): arm for arm, row in rows}
        self._shown = {row.shown.key(session): arm for arm, row in rows}

    def keys(self) -> list[str]:
        """Return the keys to listen to on the surgeon's network."""
        return [*self._back, *self._shown]

    def take(self, key: str, payload: bytes, now_ns: int) -> bool:
        """Add a message; return whether the key is one of these.

        What cannot be read, is not newer, is far ahead of the run's time or cannot be a force is ignored.
        """
        try:
            if (arm := self._back.get(key)) is not None:
                self._came_back(arm, decode(payload, Wrench), now_ns)
            elif (arm := self._shown.get(key)) is not None:
                self._was_shown(arm, decode(payload, ShownForce), now_ns)
            return arm is not None
        except DecodeError:
            return True

    def _came_back(self, arm: str, wrench: Wrench, now_ns: int) -> None:
        before = self._tool.get(arm)
        is_new = before is None or wrench.sample_ns > before.sample_ns
        if is_new and wrench.sample_ns <= now_ns + _MAX_AHEAD_NS and _size(wrench.force_n) <= _MAX_TOOL_N:
            self._tool[arm] = wrench

    def _was_shown(self, arm: str, shown: ShownForce, now_ns: int) -> None:
        before, tool, t_ns = self.newest.get(arm), self._tool.get(arm), shown.sample_ns
        if before is not None and t_ns <= before.t_ns:
            return
        if t_ns > now_ns + _MAX_AHEAD_NS or FOLLOWER[shown.hand] != arm or _size(shown.force_n) > _MAX_SHOWN_N:
            return
        here, put_in_j = _of(shown.position_m), 0.0 if before is None else before.put_in_j
        if before is not None and dist(here, before.position_m) <= _MAX_STEP_M:
            # the force is held from tick to tick
            put_in_j -= sum(f * (b - a) for f, a, b in zip(before.hand_n, before.position_m, here, strict=True))
        row = FeltRow(
            t_ns, _of(shown.force_n), None if tool is None else _of(tool.force_n),
            None if tool is None else t_ns - tool.sample_ns, shown.limited, here, _of(shown.intended_m), put_in_j,
            max(0.0 if before is None else before.most_given_j, -put_in_j),
        )  # fmt: skip
        self.newest[arm] = row
        last = self.rows[arm].since(self.rows[arm].n - 1)
        if not last or t_ns - last[0].t_ns >= _ROWS_EVERY_NS:
            self.rows[arm].append(row)


def _of(vector: Vector3) -> Place:
    return vector.x, vector.y, vector.z


def _size(vector: Vector3) -> float:
    return sqrt(vector.x**2 + vector.y**2 + vector.z**2)
