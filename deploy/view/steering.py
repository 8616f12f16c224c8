"""Requests of the pages to netem's control keys, one after the other, outside the pages' thread."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Final

import zenoh

from tis.common.errors import InputError, TisError
from tis.common.runtime.emulator_client import EmulatorAddress, OtherPrefixError, Remote, connected
from tis.common.scenario.control import Acknowledgement, EmulatorState
from tis.deploy.net.control import change_requests, profile_request
from tis.deploy.net.emergency import release_all, stop_arms
from tis.deploy.net.profiles import profile_path, read_profile, shipped_names


def live_profiles() -> dict[str, str]:
    """Return the titles of the shipped profiles that a running emulator accepts: those without changes over time."""
    titles = {}
    for name in shipped_names():
        try:
            profile_request(name)
        except InputError:
            continue
        titles[name] = read_profile(profile_path(name)).title
    return titles


def describe(answer: Acknowledgement) -> str:
    """Return the answer to a request as text."""
    if not answer.accepted:
        return "refused: " + "; ".join(reason.removeprefix("control: ") for reason in answer.reasons)
    when = "" if answer.from_ns is None else f", from {answer.from_ns * 1e-9:.3f} s of run time"
    return f"done{when}"


class Steering:
    """Control connection to netem shared by all pages; a single worker thread sends the requests."""

    def __init__(self, address: EmulatorAddress) -> None:
        self._address: Final = address
        self._pool: Final = ThreadPoolExecutor(max_workers=1, thread_name_prefix="steering")
        self._stack: Final = ExitStack()
        self._remote: Remote | None = None
        self._lock: Final = threading.Lock()
        self._state: EmulatorState | None = None
        self._refreshing = False
        self.other_prefix = ""
        """In words which prefix the netem there has, if it is not this one; "" else."""
        self._secrets: Final[dict[int, str]] = {}
        self._stops: list[threading.Thread] = []

    def close(self) -> None:
        """Cancel waiting requests and close the connection."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._stack.close()

    def state(self) -> EmulatorState | None:
        """Return netem's last known state and request a new one; None before the first answer."""
        with self._lock:
            if not self._refreshing:
                self._refreshing = True
                self._pool.submit(self._refresh)
            return self._state

    def outage(self, direction: str, for_ms: float, on_answer: Callable[[str], None]) -> None:
        """Silence the network for a while."""
        self._submit(lambda remote: remote.request("outage", {"direction": direction, "for_ms": for_ms}), on_answer)

    def reset(self, on_answer: Callable[[str], None]) -> None:
        """End all changes of the network."""
        self._submit(lambda remote: remote.request("reset", {}), on_answer)

    def set_stage(self, direction: str, setting: str, on_answer: Callable[[str], None]) -> None:
        """Change one stage, like ``delay.delay_ms=50``, completed from the state in force."""
        self._submit(
            lambda remote: remote.request("set", change_requests(remote.state(), direction, [setting])), on_answer
        )

    def only_delay(self, delay_ms: float, on_answer: Callable[[str], None]) -> None:
        """Restore the scenario's own network, with this delay each way, of every message: without jitter."""

        def send(remote: Remote) -> Acknowledgement:
            done = remote.request("reset", {})
            if not done.accepted:
                return done
            state, setting = remote.state(), [f"delay.delay_ms={delay_ms:g}"]
            ways = [way for way in (state.forward, state.feedback) if way is not None]
            pipelines = [one for way in ways for one in (way.now, *(rule.now for rule in way.rules))]
            if any(one.jitter is not None for one in pipelines):
                setting.append("jitter={kind: normal, std_ms: 0}")
            return remote.request("set", change_requests(state, "both", setting))

        self._submit(send, on_answer)

    def profile(self, name: str, on_answer: Callable[[str], None]) -> None:
        """Apply a shipped profile to both directions."""
        self._submit(lambda remote: remote.request("profile", profile_request(name)), on_answer)

    def stop(self, on_answer: Callable[[str], None]) -> None:
        """Stop the arms now, and keep what ends this stop."""

        def stop() -> str:
            done = stop_arms(self._address, "live page")
            if done.token is not None:
                with self._lock:
                    self._secrets[done.token.number] = done.token.secret
            return done.text

        with self._lock:
            self._stops = [one for one in self._stops if one.is_alive()]
            self._stops.append(self._emergency(stop, on_answer))

    def release(self, on_answer: Callable[[str], None]) -> None:
        """End the emergency stops of the pages, and those of others that the scenario lets anyone end.

        A stop acts, and pages show it, before what ends it is kept here: so a release waits for the stops before it.
        """
        with self._lock:
            before = list(self._stops)

        def release() -> str:
            for stop in before:
                stop.join()
            with self._lock:
                known = dict(self._secrets)
            return release_all(self._address, known)

        self._emergency(release, on_answer)

    def _emergency(self, act: Callable[[], str], on_answer: Callable[[str], None]) -> threading.Thread:
        """Do it in a thread of its own, which is returned: no other request of a page holds it up."""

        def work() -> None:
            try:
                on_answer(act())
            except (TisError, zenoh.ZError) as error:
                on_answer(f"not done: {error}")

        thread = threading.Thread(target=work, name="emergency stop", daemon=True)
        thread.start()
        return thread

    def _submit(self, send: Callable[[Remote], Acknowledgement], on_answer: Callable[[str], None]) -> None:
        def work() -> None:
            try:
                answer = describe(send(self._connected()))
            except (TisError, zenoh.ZError) as error:
                answer = f"not done: {error}"
            self._refresh()  # shows the effect immediately
            on_answer(answer)

        self._pool.submit(work)

    def _refresh(self) -> None:
        try:
            found: EmulatorState | None = self._connected().state()
        except (TisError, zenoh.ZError) as error:
            found = None
            self.other_prefix = error.faults[0].rule if isinstance(error, OtherPrefixError) else ""
        with self._lock:
            self._state, self._refreshing = found, False

    def _connected(self) -> Remote:
        if self._remote is None:
            self._remote = self._stack.enter_context(connected(self._address))
        return self._remote
