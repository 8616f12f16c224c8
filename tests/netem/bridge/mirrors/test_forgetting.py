"""Tokens that are gone: nothing of them is kept, and what still crosses of them brings none back."""

from types import SimpleNamespace
from typing import Any

from tis.netem.bridge.mirrors.tokens import Tokens
from tis.netem.link.packet import Fate

PACKET: Any = None


class Wire:
    """A bridge whose packets cross when the test says so, each with one copy."""

    def __init__(self) -> None:
        self.links = {"forward": None, "feedback": None}
        self.is_running = True
        self.items: list[Any] = []
        self.outcome: Any = "deliver"
        self.failed = self.in_outage = lambda *_: False

    def offer(self, *arguments: Any) -> Fate:
        if self.outcome != "deliver":
            return Fate(0, self.outcome)
        self.items.append(arguments[4])  # behind direction, name, attachment and size
        return Fate(0, "deliver", n_copies=1)


class Liveliness:
    """A network's tokens; it answers no query."""

    def __init__(self) -> None:
        self.declared: list[str] = []

    def liveliness(self) -> "Liveliness":
        return self

    def declare_token(self, key: str) -> Any:
        self.declared.append(key)
        return SimpleNamespace(undeclare=lambda: self.declared.remove(key))

    def get(self, key: str, handler: Any, timeout: float) -> None:
        pass


def some_tokens() -> tuple[Tokens, Wire, Liveliness]:
    wire, west, east = Wire(), Liveliness(), Liveliness()
    sessions: Any = {"west": west, "east": east}
    return Tokens(wire, sessions, 2.0), wire, east  # type: ignore[arg-type]


def _perform(tokens: Tokens) -> None:
    while not tokens.executor._acts.empty():
        act = tokens.executor._acts.get()
        assert act is not None
        act()


def _n_known(tokens: Tokens) -> int:
    state = tokens._states["forward"]
    known: list[dict[str, Any]] = [state.alive, state.numbers, state.applied, state.mirrors]
    return sum(map(len, [*known, state.retries, state.n_crossing]))


def test_a_late_copy_does_not_bring_back_a_token_that_is_gone() -> None:
    tokens, wire, east = some_tokens()
    tokens._take("forward", "a", True, 0.0)
    tokens._take("forward", "a", False, 0.0)
    came, left = wire.items
    for change in (came, left, left):
        change.forward(PACKET)
        _perform(tokens)
    assert east.declared == []
    assert _n_known(tokens) > 0  # a copy is still to come
    came.forward(PACKET)
    _perform(tokens)
    assert east.declared == []
    assert _n_known(tokens) == 0


def test_thousands_of_tokens_that_come_and_go_leave_nothing() -> None:
    tokens, wire, east = some_tokens()
    for i in range(2000):
        for alive in (True, False):
            tokens._take("forward", f"robot/{i}", alive, 0.0)
            for change in wire.items:
                change.forward(PACKET)
                change.drop()  # the copy
            wire.items.clear()
            _perform(tokens)
    assert east.declared == []
    assert _n_known(tokens) == 0


def test_a_lost_change_is_kept_until_it_has_arrived() -> None:
    tokens, wire, east = some_tokens()
    tokens._take("forward", "a", True, 0.0)
    for _ in range(2):
        wire.items[0].forward(PACKET)
    _perform(tokens)
    assert east.declared == ["a"]
    wire.outcome = "loss"
    tokens._take("forward", "a", False, 0.0)
    assert _n_known(tokens) > 0
    wire.outcome = "deliver"
    tokens._send("forward", "a")
    for _ in range(2):
        wire.items[1].forward(PACKET)
    _perform(tokens)
    assert east.declared == []
    assert _n_known(tokens) == 0


def test_what_no_rule_lets_cross_is_forgotten_when_it_is_gone() -> None:
    tokens, wire, _ = some_tokens()
    wire.outcome = "refused"
    for alive in (True, False):
        tokens._take("forward", "a", alive, 0.0)
    assert _n_known(tokens) == 0


def test_withdrawals_are_remembered_for_two_seconds() -> None:
    tokens, _, _ = some_tokens()
    state = tokens._states["forward"]
    for i in range(100):
        state.withdrew(f"{i}", 0.1 * i)
    assert len(state.withdrawn_s) == 20
    state.withdrew("99", 10.0)
    assert len(state.withdrawn_s) <= 20
