"""A netem that runs by itself, on the page: what crosses it each way and the network in force, by its own answers."""

from collections import deque
from collections.abc import Sequence
from html import escape
from typing import Final, NamedTuple, get_args

from tis.common.channels import Direction
from tis.common.scenario.control import EmulatorState, RecentDelays
from tis.deploy.net.control import notes_on, state_table
from tis.netem.expected.synopsis import direction_label

WINDOW_S: Final = 5.0
GONE_S: Final = 5.0
"""Time without a new answer after which netem has ended: longer than a question takes to fail."""


class Passing(NamedTuple):
    """What crossed in one direction between two answers: messages offered a second, and the share lost in percent."""

    per_s: float
    lost_pct: float | None


def passing(first: EmulatorState, last: EmulatorState, direction: Direction) -> Passing | None:
    """Return what crossed between two answers; None without time between them (oracle: literals)."""
    before, after = getattr(first, direction), getattr(last, direction)
    seconds = (last.at_s or 0.0) - (first.at_s or 0.0)
    if before is None or after is None or seconds <= 0:
        return None
    grown = {name: n - before.counters.get(name, 0) for name, n in after.counters.items()}
    n_offered, n_lost = grown.get("offered", 0), sum(n for name, n in grown.items() if name.startswith("dropped."))
    return Passing(n_offered / seconds, 100 * n_lost / n_offered if n_offered else None)


class NetemAlone:
    """The answers of a netem that runs by itself; before the first of them, nothing is known of any."""

    def __init__(self) -> None:
        self._states: deque[EmulatorState] = deque()
        self._heard_s = 0.0
        self.is_over = False

    @property
    def is_there(self) -> bool:
        """Tell whether such a netem has answered."""
        return bool(self._states)

    def take(self, state: EmulatorState | None, now_s: float) -> None:
        """Add the newest answer, which may be known already; None: there was none."""
        states = self._states
        if state is not None and state.standalone and (not states or state.at_s != states[-1].at_s):
            at_s = state.at_s or 0.0
            if states and at_s < (states[-1].at_s or 0.0):  # it was started anew
                states.clear()
            states.append(state)
            while len(states) > 2 and at_s - (states[1].at_s or 0.0) >= WINDOW_S:
                states.popleft()
            self._heard_s = now_s
        self.is_over = self.is_there and now_s - self._heard_s > GONE_S

    def words(self) -> str:
        """Return in a sentence how it stands."""
        at_s = self._states[-1].at_s or 0.0
        if self.is_over:
            return f"netem does not answer any more; it ran for {at_s:.0f} s at least."
        return f"netem runs by itself, without surgeon and patient: {at_s:.0f} s"

    def figures_html(self) -> str:
        """Return what crosses each way as tiles, with the words of their meaning."""
        first, last = self._states[0], self._states[-1]
        tiles: list[tuple[str, str, str]] = []
        for direction in get_args(Direction):
            way, found = getattr(last, direction), passing(first, last, direction)
            delays = None if way is None else way.delays
            tiles += _tiles(direction_label(direction), found, delays, way is not None and way.outage)
        items = "".join(
            f"<li><span>{escape(name)}</span><strong>{escape(value)}</strong><small>{escape(meaning)}</small></li>"
            for name, value, meaning in tiles
        )
        note = (
            "By netem's own counts and clock: a delay is from a message's arrival at netem to its leaving. What it "
            "waited for before, in its sender or in TCP, is not in it."
        )
        return f'<ul class="tiles">{items}</ul><p class="note">{note}</p>'

    def state_html(self) -> str:
        """Return the network in force in the words of `tis net show`."""
        last = self._states[-1]
        notes = "".join(f'<p class="note">{escape(line)}</p>' for line in notes_on(last))
        return f"{state_table(last).html()}{notes}"


def _tiles(
    name: str, found: Passing | None, delays: RecentDelays | None, is_outage: bool
) -> Sequence[tuple[str, str, str]]:
    """Return the tiles of one direction: heading, value and meaning."""
    n = "–" if found is None else f"{found.per_s:.0f} /s"
    lost = "–" if found is None or found.lost_pct is None else f"{found.lost_pct:.3g} %"
    delay = "–" if delays is None else f"{delays.p50_ms:.2f} ms"
    spread = f"nothing left in the last {WINDOW_S:g} s"
    if delays is not None:
        spread = f"median (p50) of {delays.n} that left; p99 {delays.p99_ms:.2f} ms"
    return (
        (f"{name}: offered", n, "messages a second" + (", in an outage: all are lost" if is_outage else "")),
        (f"{name}: lost", lost, "of what was offered, by all causes"),
        (f"{name}: delay", delay, spread),
    )
