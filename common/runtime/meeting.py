"""Meeting of the sides: who is present, who left, why a run ends, and in which fields their scenarios differ."""

import contextlib
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Self

import zenoh

from tis.common.channels import Network, Side
from tis.common.errors import Fault, PeerError
from tis.common.runtime.control import Bell, ControlKeys, Presence, Roster
from tis.common.runtime.process import Interrupt
from tis.common.scenario import Scenario
from tis.common.scenario import reading as scenario_io
from tis.common.scenario.reading import agreed_fields, checked_fields, differences, in_words

MAX_BYTES: Final = 500_000
_ANSWER_S: Final = 3.0
_LINGER_S: Final = 2.0


class ScenarioExchange:
    """Answers the other sides' questions for this side's scenario, and asks for theirs.

    A side that asked stays for a moment, so that the other one, which ends for the same reason, gets its answer.
    """

    def __init__(
        self, sessions: Mapping[Network, zenoh.Session], keys: ControlKeys, side: Side, scenario: Scenario
    ) -> None:
        self._sessions = sessions
        self._keys = keys
        self._fields: Final = agreed_fields(scenario)
        self._has_asked = False
        self._was_asked = threading.Event()
        own, text = keys.scenario(side), json.dumps(self._fields)

        def answer(query: zenoh.Query) -> None:
            with contextlib.suppress(zenoh.ZError), query:  # who asked may be gone
                query.reply(own, text)
            self._was_asked.set()

        self._held: list[Any] = [
            session.declare_queryable(own, answer, complete=True, allowed_origin=zenoh.Locality.REMOTE)
            for session in sessions.values()
        ]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._has_asked:
            self._was_asked.wait(_LINGER_S)
        for queryable in self._held:
            queryable.undeclare()
        self._held.clear()

    def difference(self, network: Network, side: Side) -> str:
        """Return in which fields a side's scenario differs, as text; empty when it does not answer."""
        self._has_asked = True
        key = self._keys.scenario(side)
        for reply in self._sessions[network].get(key, timeout=_ANSWER_S):
            ok = reply.ok
            if ok is None or str(ok.key_expr) != key or len(ok.payload) > MAX_BYTES:
                continue
            there = checked_fields(ok.payload.to_bytes())
            if there is not None:
                return in_words(differences(self._fields, there))
        return ""


@dataclass
class Meeting:
    """A side's part of the control plane: one roster per network, and the bell that wakes waiting threads."""

    scenario: Scenario
    side: Side
    rosters: Mapping[Network, Roster]
    bell: Bell
    interrupt: Interrupt
    digest: str = field(init=False)
    exchange: ScenarioExchange | None = None
    """The way to another side's scenario; None before there is a session."""

    def __post_init__(self) -> None:
        self.digest = scenario_io.digest(self.scenario)  # once: the loop asks for the lost sides at every turn

    @property
    def keys(self) -> ControlKeys:
        """Return the session's control keys."""
        return ControlKeys(self.scenario.session)

    def end_reason(self) -> str | None:
        """Return the reason for which another side ended the run, None if none did."""
        return next((r.end_reason for r in self.rosters.values() if r.end_reason is not None), None)

    def lost(self) -> list[Side]:
        """Return the sides that left and are not back, netem first: when it dies, the other side's mirror goes too.

        A stranger's token of another scenario is no side of this run.
        """
        if not any(roster.left for roster in self.rosters.values()):  # as at nearly every turn of the loop
            return []
        left = (one for roster in self.rosters.values() for one in tuple(roster.left))
        sides = {one.side for one in left if one.digest == self.digest}
        return sorted(sides - {self.side} - self.present(), key=lambda side: (side != "netem", side))

    def present(self) -> set[Side]:
        """Return the sides of this run that are present; netem's own mirrors tell netem nothing."""
        here = (one for roster in self.rosters.values() for one in tuple(roster.present))
        return {one.side for one in here if one.digest == self.digest and not (one.mirrored and self.side == "netem")}

    def check_scenarios(self) -> None:
        """Raise `PeerError` when a side that is or was present runs another scenario; it names the fields."""
        others = {
            (network, presence)
            for network, roster in self.rosters.items()
            for presence in tuple(roster.met)
            if presence.digest != self.digest
        }
        if others:
            # A mirrored token has netem's digest and says nothing that netem's own does not.
            own = {other for other in others if not other[1].mirrored}
            raise PeerError(sorted({self._differs(*other) for other in own or others}, key=str))

    def _differs(self, network: Network, presence: Presence) -> Fault:
        rule = f"must be the one that {self.side} runs"
        fields = "" if self.exchange is None else self.exchange.difference(network, presence.side)
        if fields:
            return Fault(presence.side, "scenario", f"{rule}: {fields}")
        return Fault(presence.side, "scenario", f"{rule} ({self.digest})", presence.digest)


def new_meeting(
    scenario: Scenario, side: Side, networks: Sequence[Network], interrupt: Interrupt, wake: Callable[[], None]
) -> Meeting:
    """Return a meeting whose changes wake the barrier and, by ``wake``, the loop."""
    bell = Bell()

    def changed() -> None:
        bell.ring()
        wake()

    interrupt.wakers.append(changed)
    keys = ControlKeys(scenario.session)
    return Meeting(scenario, side, {n: Roster(keys, changed) for n in networks}, bell, interrupt)
