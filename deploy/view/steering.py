"""The network's controls for pages: requests to netem's control keys, one after the other, off the page's thread."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Final

import zenoh

from common.errors import InputError, TisError
from common.scenario.control import Acknowledgement, EmulatorState
from deploy.net.control.control_commands import change_requests, profile_request
from deploy.net.control.remote import Place, Remote, connected
from deploy.net.library.profiles import shipped_names


def live_profiles() -> list[str]:
    """Return the shipped profiles that a running emulator can take on: those that stay as they are."""
    names = []
    for name in shipped_names():
        try:
            profile_request(name)
        except InputError:
            continue
        names.append(name)
    return names


def describe(answer: Acknowledgement) -> str:
    """Return what came of a request, in words."""
    if not answer.accepted:
        return "refused: " + "; ".join(reason.removeprefix("control: ") for reason in answer.reasons)
    when = "" if answer.from_ns is None else f", from {answer.from_ns * 1e-9:.3f} s of run time"
    return f"done{when}"


class Steering:
    """One connection to netem's control keys, shared by all pages; each request is done in one thread of its own."""

    def __init__(self, place: Place) -> None:
        self._place: Final = place
        self._pool: Final = ThreadPoolExecutor(max_workers=1, thread_name_prefix="steering")
        self._stack: Final = ExitStack()
        self._remote: Remote | None = None
        self._lock: Final = threading.Lock()
        self._state: EmulatorState | None = None
        self._asking = False

    def close(self) -> None:
        """Ask no more, and close the connection."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._stack.close()

    def state(self) -> EmulatorState | None:
        """Return what netem said last, and have it asked again; None before it answered."""
        with self._lock:
            if not self._asking:
                self._asking = True
                self._pool.submit(self._refresh)
            return self._state

    def outage(self, direction: str, for_ms: float, tell: Callable[[str], None]) -> None:
        """Silence the network for a while."""
        self._submit(lambda remote: remote.request("outage", {"direction": direction, "for_ms": for_ms}), tell)

    def reset(self, tell: Callable[[str], None]) -> None:
        """Take back everything that was asked for."""
        self._submit(lambda remote: remote.request("reset", {}), tell)

    def set_stage(self, direction: str, setting: str, tell: Callable[[str], None]) -> None:
        """Change one stage, like ``delay.delay_ms=50``, completed from what holds now."""
        self._submit(
            lambda remote: remote.request("set", change_requests(remote.state(), direction, [setting])), tell
        )

    def profile(self, name: str, tell: Callable[[str], None]) -> None:
        """Let both directions be those of a shipped profile."""
        self._submit(lambda remote: remote.request("profile", profile_request(name)), tell)

    def _submit(self, ask: Callable[[Remote], Acknowledgement], tell: Callable[[str], None]) -> None:
        def work() -> None:
            try:
                answer = describe(ask(self._connected()))
            except (TisError, zenoh.ZError) as error:
                answer = f"not done: {error}"
            self._refresh()  # what came of it is seen at once
            tell(answer)

        self._pool.submit(work)

    def _refresh(self) -> None:
        try:
            found: EmulatorState | None = self._connected().state()
        except (TisError, zenoh.ZError):
            found = None
        with self._lock:
            self._state, self._asking = found, False

    def _connected(self) -> Remote:
        if self._remote is None:
            self._remote = self._stack.enter_context(connected(self._place))
        return self._remote
