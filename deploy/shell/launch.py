"""Child processes of `tis run`: start, events, signals and the run's outcome."""

import contextlib
import json
import queue
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tis.common.channels import Side
from tis.common.errors import EXIT_OK
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.process import Interrupt, child_environment
from tis.common.scenario import Scenario
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.outcome import Event, Outcome, SideEnd, outcome_of, reasons_of

MODULES: Final[dict[Side, str]] = {"surgeon": "tis.surgeon_side", "netem": "tis.netem", "patient": "tis.patient_side"}
_POLL_S: Final = 0.2
_GRACE_S: Final = 2.5
_BARRIER_S: Final = 120
_MAX_LAST_LINES: Final = 5


@dataclass
class Child:
    """Process of one side with its events and its last lines of output."""

    side: Side
    process: subprocess.Popen[str]
    events: list[Event] = field(default_factory=list)
    last_lines: deque[str] = field(default_factory=lambda: deque(maxlen=_MAX_LAST_LINES))
    readers: list[threading.Thread] = field(default_factory=list)
    signalled: bool = False

    def end(self, number: signal.Signals = signal.SIGTERM) -> None:
        """Send a signal if the process is still running."""
        if self.process.poll() is None:
            self.signalled = True
            self.process.send_signal(number)

    def ending(self) -> SideEnd:
        """Return how the process, which is over, ended."""
        reasons = reasons_of(self.events, self.last_lines)
        return SideEnd(self.side, self.process.returncode, tuple(reasons), self.signalled)


def endpoints_of(scenario: Scenario) -> tuple[str, str]:
    """Return netem's endpoints, west and east: the scenario's, or free ports of loopback."""
    if scenario.hosts != "auto":
        return scenario.hosts.endpoints
    return free_endpoints("tls" if scenario.security.kind == "mtls" else "tcp")


def launch(
    scenario: Scenario, run_dir: Path, on_event: Callable[[Event], None],
    endpoints: tuple[str, str] | None = None, insecure: bool = False, foreign_surgeon: bool = False,
) -> Outcome:  # fmt: skip
    """Run the three sides as child processes until all have ended; leaves no child behind.

    ``endpoints`` are netem's, west and east; by default the scenario's. ``insecure``: netem may listen there even if
    anybody may connect. ``foreign_surgeon``: another program is the surgeon, ours only writes its log.
    """
    west, east = endpoints or endpoints_of(scenario)
    places = {
        "netem": ["--listen", west, "--listen", east, *(["--insecure"] if insecure else [])],
        "surgeon": ["--connect", west, *(["--witness"] if foreign_surgeon else [])],
        "patient": ["--connect", east],
    }
    events: queue.SimpleQueue[tuple[Side, Event | None]] = queue.SimpleQueue()
    interrupt = Interrupt()
    children: dict[Side, Child] = {}
    with interrupt.installed(), _children_reaped(children):
        for side in ("netem", "patient", "surgeon"):
            children[side] = _spawn(side, run_dir, places[side], events)
        _watch(
            children, events, interrupt, on_event, tolerates_failures=scenario.peer_loss_policy(False) == "continue"
        )
    return outcome_of({side: child.ending() for side, child in children.items()}, interrupt.requested)


def _spawn(
    side: Side, run_dir: Path, place: list[str], events: "queue.SimpleQueue[tuple[Side, Event | None]]"
) -> Child:
    command = [sys.executable, "-m", MODULES[side], str(run_dir / folder.SCENARIO_FILE)]
    command += ["--child", "--run-dir", str(run_dir), "--wait-s", str(_BARRIER_S), *place]
    # A separate session: Ctrl-C reaches this process only, which then ends the children in order.
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
                child.last_lines.append(line.rstrip())
            else:
                child.events.append(event)
                events.put((side, event))
        events.put((side, None))

    def read_errors() -> None:
        assert process.stderr is not None
        for line in process.stderr:
            child.last_lines.append(line.rstrip())

    for target in (read_events, read_errors):
        child.readers.append(threading.Thread(target=target, daemon=True))
        child.readers[-1].start()
    return child


def _event(line: str) -> Event | None:
    """Return the event in a line; None for any other output."""
    try:
        event = json.loads(line)
    except ValueError:
        return None
    return event if isinstance(event, dict) and {"side", "event"} <= event.keys() else None


def _watch(
    children: dict[Side, Child],
    events: "queue.SimpleQueue[tuple[Side, Event | None]]",
    interrupt: Interrupt,
    on_event: Callable[[Event], None],
    tolerates_failures: bool,
) -> None:
    """Pass events on until every child has closed its output.

    An interrupt ends all children; so does a failed child, unless the run ``tolerates_failures``.
    """
    # Events come from reader threads through one queue, so that this loop also sees interrupts and exits.
    closed: set[Side] = set()
    ending = False
    while len(closed) < len(children):
        with contextlib.suppress(queue.Empty):
            side, event = events.get(timeout=_POLL_S)
            if event is None:
                closed.add(side)
                code = children[side].process.wait()
                if code != EXIT_OK and not ending and not tolerates_failures:
                    ending = True
                    _schedule_signals(children)
            else:
                on_event(event)
        if interrupt.requested and not ending:
            ending = True
            for child in children.values():
                on_event({"side": child.side, "event": "ending"})
                child.end()
            _schedule_signals(children)


def _schedule_signals(children: dict[Side, Child]) -> None:
    """Give the children time to end by themselves, as they do when a peer leaves; then SIGTERM, then SIGKILL."""

    def signal_all(number: signal.Signals) -> None:
        for child in children.values():
            child.end(number)

    for delay_s, number in ((_GRACE_S / 2, signal.SIGTERM), (_GRACE_S, signal.SIGKILL)):
        timer = threading.Timer(delay_s, signal_all, [number])
        timer.daemon = True
        timer.start()


@contextlib.contextmanager
def _children_reaped(children: dict[Side, Child]) -> Iterator[None]:
    """Kill and reap every child at the end of the block, whatever happens within it."""
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
