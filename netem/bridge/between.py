"""A bad network for a program's own tests: netem in a process of its own, between two Zenoh endpoints.

Examples
--------
>>> from tis.netem.bridge.between import between
>>> with between("wifi_bad", seed=3) as net:  # doctest: +SKIP
...     west = open_session(connect=net.west)
...     east = open_session(connect=net.east)
...     net.outage(0.5)
>>> net.faithful  # doctest: +SKIP
{'forward': True, 'feedback': True}
"""

import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final, Literal

from tis.common.errors import Fault, InputError, PeerError
from tis.common.runtime.emulator_client import EmulatorAddress, connected
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.process import child_environment
from tis.common.runtime.status import BYPASS, warning_line
from tis.common.units import NS_PER_S

Ways = Literal["forward", "feedback", "both"]

# Summarized in netem's process: another one would take as long again to load.
_COMMAND: Final = (sys.executable, "-m", "tis.deploy.cli.main", "netem", "--summarize")
_RUNNING: Final = "netem: running"
_WARNING: Final = f"netem: {warning_line('')}"
_BYPASS: Final = f"netem: {warning_line('', BYPASS)}"
_START_S: Final = 60.0
_END_S: Final = 300.0  # netem ends itself within seconds; then it reads its log
_MAX_LINES: Final = 200
_COUNTED: Final = ("offered", "copied", "released", "dropped")


class Between:
    """A running emulator between two networks; `between` makes it.

    Attributes
    ----------
    west, east
        Endpoints for the programs of either side, such as ``tcp/127.0.0.1:40123``. *forward* is from west to east.
    run_dir
        Folder of its log, and of its summary after the end; ``tis report`` makes a page of it.
    summary
        What was requested, decided and realised, with a verdict for each direction, as in ``summary.json``; empty
        before the end.
    warnings
        What netem warned of, as it said it; complete after the end.
    bypasses
        Those of ``warnings`` that tell of a way past netem; what else shows a way that is told is not among them.
    may_bypass
        Whether the fixture ``tis_netem`` accepts ways past it.
    exit_code
        That of netem after the end; 5 means not valid.
    """

    def __init__(self, west: str, east: str, run_dir: Path) -> None:
        self.west, self.east, self.run_dir = west, east, run_dir
        self.summary: dict[str, Any] = {}
        self.warnings: list[str] = []
        self.bypasses: list[str] = []
        self.may_bypass = False
        self.exit_code: int | None = None
        self._counted: dict[str, dict[str, int]] = {}

    def __iter__(self) -> Iterator[str]:
        """Yield both endpoints: ``west, east = net``."""
        return iter((self.west, self.east))

    def outage(self, for_s: float, direction: Ways = "both") -> None:
        """Let nothing pass for so many seconds; returns when that holds."""
        self._ask("outage", {"direction": direction, "for_ms": 1000 * for_s})

    def stall(self, for_s: float, direction: Ways = "both") -> None:
        """Let everything wait for so many seconds, and then leave together; returns when that holds."""
        self._ask("outage", {"direction": direction, "for_ms": 1000 * for_s, "effect": "stall"})

    def change(self, change: Mapping[str, Any], direction: Ways = "both", for_s: float | None = None) -> None:
        """Change the network, for some seconds or until it is changed again or `reset`; returns when that holds.

        ``change`` has the form of ``set`` in a scenario's timeline, such as ``{"delay": {"kind": "constant",
        "delay_ms": 80}}`` or ``{"clean": True}``. It replaces only the stages that it names: earlier changes of
        others stay. Raises `InputError` for what the emulator refuses.
        """
        request: dict[str, Any] = {"direction": direction, "change": dict(change)}
        self._ask("set", request if for_s is None else request | {"for_s": for_s})

    def profile(self, name: str) -> None:
        """Put a static network of the library in place of all changes; returns when that holds."""
        self._ask("profile", {"profile": name})

    def reset(self) -> None:
        """End all changes and outages; returns when that holds."""
        self._ask("reset", {})

    def counts(self) -> dict[str, dict[str, int]]:
        """Return while it runs, by direction, the messages since its start or `count_anew`, by outcome.

        Outcomes are ``offered``, ``copied`` (duplicates), ``released``, and ``dropped.loss`` and its like by cause.
        """
        now, before = self._counters(), self._counted
        return {
            direction: {name: n - before.get(direction, {}).get(name, 0) for name, n in found.items()}
            for direction, found in now.items()
        }

    def count_anew(self) -> None:
        """Let `counts` begin at zero."""
        self._counted = self._counters()

    def n_bypasses(self) -> int:
        """Return while it runs the number of ways past netem that it has found."""
        with connected(EmulatorAddress(self.west)) as remote:
            return remote.state().counters.get("leaks", 0)

    @property
    def faithful(self) -> dict[str, bool | None]:
        """Return by direction whether the network was as requested, None: not decidable; empty before the end."""
        return {direction: link["verdict"]["faithful"] for direction, link in self.summary.get("links", {}).items()}

    def _counters(self) -> dict[str, dict[str, int]]:
        with connected(EmulatorAddress(self.west)) as remote:
            state = remote.state()
        ways = {"forward": state.forward, "feedback": state.feedback}
        return {
            direction: {name: n for name, n in way.counters.items() if name.partition(".")[0] in _COUNTED}
            for direction, way in ways.items()
            if way is not None
        }

    def _ask(self, operation: str, request: Mapping[str, Any]) -> None:
        with connected(EmulatorAddress(self.west)) as remote:
            answer = remote.request(operation, request)
        if not answer.accepted:
            raise InputError(
                [Fault("netem", operation, reason.removeprefix("control: ")) for reason in answer.reasons]
            )
        # A change holds from the next ms: what the caller sends now must meet it.
        time.sleep(((answer.from_ns or 0) - (answer.at_ns or 0)) / NS_PER_S)


@contextmanager
def between(
    profile: str | None = None,
    *,
    network: Path | str | None = None,
    settings: Sequence[str] = (),
    seed: int = 0,
    keys: Sequence[str] = ("**",),
    endpoints: tuple[str, str] | None = None,
    run_dir: Path | str | None = None,
    options: Sequence[str] = (),
) -> Iterator[Between]:
    """Run netem between two endpoints while the block lasts; then compute its proof.

    Parameters
    ----------
    profile
        Name of a network of the library (``tis net profiles``).
    network
        File with a network, or a scenario whose network counts; not together with ``profile``.
    settings
        Changes of the network, as after ``--set``: ``forward.loss.p_loss=0.1``.
    seed
        Of all random numbers: the same seed makes the same decisions for the same messages.
    keys
        Key expressions that cross.
    endpoints
        Where netem listens, west and east; free ports of loopback when not given.
    run_dir
        New folder for log and summary; a temporary one when not given, which stays.
    options
        Further options of ``tis netem``.

    Raises
    ------
    InputError
        When the network or an option is not valid.
    PeerError
        When netem does not start, or fails.
    """
    west, east = endpoints or free_endpoints()
    folder = Path(tempfile.mkdtemp(prefix="tis-netem-")) / "run" if run_dir is None else Path(run_dir)
    words = [*_COMMAND, *keys, "--west", west, "--east", east, "--seed", str(seed), "--run-dir", str(folder)]
    words += [] if profile is None else ["--profile", profile]
    words += [] if network is None else ["--scenario-network", str(network)]
    words += [word for setting in settings for word in ("--set", setting)]
    net = Between(west, east, folder)
    process = subprocess.Popen(  # noqa: S603  (its own: netem asks for real-time scheduling, and collects no garbage)
        [*words, *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=child_environment()
    )
    said = _Said(process, net)
    try:
        said.await_running()
        yield net
    finally:
        _end(process)
        said.close()
    if process.returncode not in (0, 5, 130):
        raise PeerError(Fault("netem", "", said.text()))
    net.exit_code = process.returncode
    net.summary = _summary(folder)


class _Said:
    """Reads what netem says, so that it never waits for its reader."""

    def __init__(self, process: "subprocess.Popen[str]", net: Between) -> None:
        assert process.stderr is not None
        self._net = net
        self._process, self._lines = process, list[str]()
        self._running = threading.Event()
        self._thread = threading.Thread(target=self._read, args=(process.stderr,), name="netem says", daemon=True)
        self._thread.start()

    def await_running(self) -> None:
        """Wait until messages cross; raises `InputError` or `PeerError`."""
        if not self._running.wait(_START_S):
            raise PeerError(Fault("netem", "", f"did not start within {_START_S:g} s: {self.text()}"))
        if not self._has_begun():
            code = self._process.wait(_END_S)
            raise (InputError if code == InputError.exit_code else PeerError)(Fault("netem", "", self.text()))

    def text(self) -> str:
        """Return what it said, in one line."""
        return " ".join(" ".join(self._lines).split()) or f"exit code {self._process.poll()}"

    def close(self) -> None:
        """Read to the end."""
        self._thread.join(_END_S)

    def _has_begun(self) -> bool:
        return any(line.startswith(_RUNNING) for line in self._lines)

    def _read(self, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                self._lines = [*self._lines[-_MAX_LINES:], line]
                is_bypass = line.startswith(_BYPASS)
                if (is_bypass or line.startswith(_WARNING)) and len(self._net.warnings) < _MAX_LINES:
                    text = line.removeprefix(_BYPASS if is_bypass else _WARNING).strip()
                    self._net.warnings.append(text)
                    self._net.bypasses += [text] if is_bypass else []
                if line.startswith(_RUNNING):
                    self._running.set()
        self._running.set()  # it has ended


def _end(process: "subprocess.Popen[str]") -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _summary(folder: Path) -> dict[str, Any]:
    """Return the summary that netem has written; raises `PeerError` when there is none."""
    try:
        return dict(json.loads((folder / "summary.json").read_bytes()))
    except (OSError, ValueError) as error:
        raise PeerError(Fault(str(folder), "", f"netem left no summary: {error}")) from None
