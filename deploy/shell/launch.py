"""`tis run`: three processes on this machine, watched until the last one is gone."""

import contextlib
import json
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, get_args

from common.channels import Side
from common.errors import EXIT_INTERRUPTED, EXIT_OK, PeerError
from common.runtime.child_process import child_environment
from common.runtime.interrupt import Interrupt
from common.scenario import Scenario
from deploy.shell import run_dir as folder

_MODULES: Final[dict[Side, str]] = {"surgeon": "surgeon_side", "netem": "netem", "patient": "patient_side"}
_GLANCE_S: Final = 0.2
_GRACE_S: Final = 2.5
_BARRIER_S: Final = 120
_LAST_WORDS: Final = 5

Event = dict[str, Any]


@dataclass
class Child:
    """One side's process and what it has said."""

    side: Side
    process: subprocess.Popen[str]
    events: list[Event] = field(default_factory=list)
    last_words: deque[str] = field(default_factory=lambda: deque(maxlen=_LAST_WORDS))
    readers: list[threading.Thread] = field(default_factory=list)
    told_to_end: bool = False

    def end(self, number: signal.Signals = signal.SIGTERM) -> None:
        """Tell it to end, if it has not."""
        if self.process.poll() is None:
            self.told_to_end = True
            self.process.send_signal(number)

    def reasons(self) -> list[str]:
        """Return why it failed, in its own words, else the last lines it wrote, else what it last counted."""
        failed = next((event for event in self.events if event["event"] == "failed"), None)
        if failed is not None:
            return [str(reason) for reason in failed["reasons"]]
        if self.last_words:
            return list(self.last_words)
        last = next((event for event in reversed(self.events) if event["event"] == "progress"), None)
        if last is None:
            return []
        counts = ", ".join(f"{name} {n}" for name, n in last["counters"].items() if n)
        return [f"at {last['now_s']:.1f} s: {counts}"]


@dataclass(frozen=True)
class Outcome:
    """How a run ended: the command's exit code, why, and each child's exit code."""

    exit_code: int
    reasons: tuple[str, ...]
    exit_codes: dict[Side, int]


def free_endpoints() -> tuple[str, str]:
    """Return two loopback endpoints whose ports are free now."""
    with socket.socket() as one, socket.socket() as two:
        one.bind(("127.0.0.1", 0))
        two.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{one.getsockname()[1]}", f"tcp/127.0.0.1:{two.getsockname()[1]}"


def endpoints_of(scenario: Scenario) -> tuple[str, str]:
    """Return where netem is to listen, west and east: as the scenario says, or free ports of loopback."""
    return free_endpoints() if scenario.hosts == "auto" else (scenario.hosts.west, scenario.hosts.east)


def launch(
    scenario: Scenario, run_dir: Path, on_event: Callable[[Event], None], endpoints: tuple[str, str] | None = None
) -> Outcome:
    """Run the three sides as child processes until all have ended; leaves no child behind.

    ``endpoints`` are netem's, west and east; the scenario's when not given.
    """
    west, east = endpoints or endpoints_of(scenario)
    places = {
        "netem": ["--listen", west, "--listen", east],
        "surgeon": ["--connect", west],
        "patient": ["--connect", east],
    }
    heard: queue.SimpleQueue[tuple[Side, Event | None]] = queue.SimpleQueue()
    interrupt = Interrupt()
    children: dict[Side, Child] = {}
    with interrupt.installed(), _all_gone(children):
        for side in ("netem", "patient", "surgeon"):
            children[side] = _spawn(side, run_dir, places[side], heard)
        _watch(children, heard, interrupt, on_event, goes_on=scenario.peer_loss_policy(False) == "continue")
    return _judge(children, interrupt.requested)


def _spawn(
    side: Side, run_dir: Path, place: list[str], heard: "queue.SimpleQueue[tuple[Side, Event | None]]"
) -> Child:
    command = [sys.executable, "-m", _MODULES[side], str(run_dir / folder.SCENARIO_FILE)]
    command += ["--child", "--run-dir", str(run_dir), "--wait-s", str(_BARRIER_S), *place]
    # A session of its own: Ctrl-C reaches this process only, which then ends the children in order.
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
        env=child_environment(),
    )
    child = Child(side, process)

    def read_events() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            event = _event(line)
            if event is None:
                child.last_words.append(line.rstrip())
            else:
                child.events.append(event)
                heard.put((side, event))
        heard.put((side, None))

    def read_errors() -> None:
        assert process.stderr is not None
        for line in process.stderr:
            child.last_words.append(line.rstrip())

    for target in (read_events, read_errors):
        child.readers.append(threading.Thread(target=target, daemon=True))
        child.readers[-1].start()
    return child


def _event(line: str) -> Event | None:
    """Return the event that a line is; None when something else printed it."""
    try:
        event = json.loads(line)
    except ValueError:
        return None
    return event if isinstance(event, dict) and {"side", "event"} <= event.keys() else None


def _watch(
    children: dict[Side, Child],
    heard: "queue.SimpleQueue[tuple[Side, Event | None]]",
    interrupt: Interrupt,
    on_event: Callable[[Event], None],
    goes_on: bool,
) -> None:
    """Pass events on until every child has closed its output.

    An interrupted run is ended for all; so is one in which a child failed, unless it ``goes_on`` without.
    """
    silent: set[Side] = set()
    ending = False
    while len(silent) < len(children):
        with contextlib.suppress(queue.Empty):
            side, event = heard.get(timeout=_GLANCE_S)
            if event is None:
                silent.add(side)
                code = children[side].process.wait()
                if code != EXIT_OK and not ending and not goes_on:
                    ending = True
                    _end_soon(children)
            else:
                on_event(event)
        if interrupt.requested and not ending:
            ending = True
            for child in children.values():
                child.end()
            _end_soon(children)


def _end_soon(children: dict[Side, Child]) -> None:
    """Give the children time to end by themselves, as they do when a peer leaves; then insist."""

    def insist(number: signal.Signals) -> None:
        for child in children.values():
            child.end(number)

    for delay_s, number in ((_GRACE_S / 2, signal.SIGTERM), (_GRACE_S, signal.SIGKILL)):
        timer = threading.Timer(delay_s, insist, [number])
        timer.daemon = True
        timer.start()


@contextlib.contextmanager
def _all_gone(children: dict[Side, Child]) -> Iterator[None]:
    """Whatever happens within the block, no child outlives it."""
    try:
        yield
    finally:
        for child in children.values():
            if child.process.poll() is None:
                child.process.kill()
            child.process.wait()
            for reader in child.readers:
                reader.join()
            for pipe in (child.process.stdout, child.process.stderr):
                if pipe is not None:
                    pipe.close()


def _judge(children: dict[Side, Child], interrupted: bool) -> Outcome:
    codes = {side: child.process.returncode for side, child in children.items()}
    if interrupted:
        return Outcome(EXIT_INTERRUPTED, ("interrupted",), codes)
    failed = [
        child
        for side in get_args(Side)
        if (child := children[side]).process.returncode != EXIT_OK and not child.told_to_end
    ]
    if not failed:
        return Outcome(EXIT_OK, (), codes)
    killed = [child for child in failed if child.process.returncode < 0]
    reasons: list[str] = []
    for child in killed:
        name = signal.Signals(-child.process.returncode).name
        words = "; ".join(child.reasons()) or "it said nothing"
        reasons.append(f"{child.side}: killed by {name}, last words: {words}")
    for child in failed:
        reasons += [reason for reason in child.reasons() if child not in killed and reason not in reasons]
    if killed:
        return Outcome(PeerError.exit_code, tuple(reasons), codes)
    own = [child.process.returncode for child in failed if child.process.returncode != PeerError.exit_code]
    return Outcome(own[0] if own else PeerError.exit_code, tuple(reasons) or ("a side failed silently",), codes)
