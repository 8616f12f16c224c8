"""Child process that serves the live page: it ends with the run and with its parent, however that ends."""

import json
import os
import subprocess
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from math import inf
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from tis.common.errors import EXIT_INTERRUPTED, EXIT_OK, Fault, InputError, PeerError
from tis.common.extras import GET_REPORT
from tis.common.runtime.emulator_client import running_here
from tis.common.runtime.process import Interrupt, child_environment, end_by_input
from tis.common.runtime.running import EAST, WEST, Running
from tis.common.runtime.signing import client_identity, secret_of
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario import Scenario
from tis.deploy.shell.guard import can_report
from tis.deploy.view.device import device_of
from tis.deploy.view.hold_reason import about_of
from tis.deploy.view.page_text import RunOutput

_GRACE_S: Final = 6.0


@dataclass(frozen=True)
class PageAddress:
    """Address of the page: of this host, with a port (0: any free port) and further names of this host."""

    address: str = "127.0.0.1"
    port: int = 0
    hosts: tuple[str, ...] = ()


def announce(url: str, err: Console) -> None:
    """Print the page's address and, with a display, open it."""
    err.print(f"live page: {url}", soft_wrap=True, markup=False, highlight=False)
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)


@dataclass
class PageProcess:
    """Process and address of the page and, after its end, the faults of the process."""

    process: "subprocess.Popen[str]"
    url: str
    faults: list[str] = field(default_factory=list)

    def send_output(self, left: RunOutput) -> None:
        """Send the run's output to the page; does nothing when its process has ended."""
        self.tell(left._asdict())

    def tell(self, content: dict[str, Any]) -> None:
        """Send a line of JSON to the process."""
        assert self.process.stdin is not None
        with suppress(BrokenPipeError):
            self.process.stdin.write(json.dumps(content) + "\n")
            self.process.stdin.flush()


@contextmanager
def page_process(
    command: str, at: PageAddress, endpoints: tuple[str, str], session: str, wait_s: float | None = None,
    beside: bool = False, zenoh: ZenohOptions | None = None, scenario: Scenario | None = None,
    secret: Path | None = None, reports: bool = True,
) -> Iterator[PageProcess]:  # fmt: skip
    """Serve the page in a process that ends with the block; raises `InputError` when it cannot be served."""
    if not can_report():
        raise InputError(Fault(command, "", f"needs Bokeh: {GET_REPORT}"))
    west, east = endpoints
    options = {"west": west, "east": east, "session": session, "wait_s": wait_s, "beside": beside, **asdict(at)}
    options |= {"reports": reports}
    options["secret"] = None if secret is None else str(secret)
    if scenario is not None:
        device = device_of(scenario)
        sight = scenario.sight and scenario.sight.model_dump(mode="json")
        options |= {"device": device and asdict(device), "about": asdict(about_of(scenario)), "sight": sight}
    if zenoh is not None:
        file = None if zenoh.config is None else str(zenoh.config)
        options |= {"config": file, "cfg": list(zenoh.cfg), "credentials": dict(zenoh.credentials)}
    with subprocess.Popen(
        [sys.executable, "-m", "tis.deploy.view"],
        stdin=subprocess.PIPE,  # closed by the kernel when this process ends, which ends the page
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,  # Ctrl-C reaches this process only, which then ends the page
        env=child_environment(),
    ) as process:
        # The first line is the address or a fault; further lines are read at the end.
        page = PageProcess(process, "")
        try:
            assert process.stdout is not None
            page.tell(options)  # not as arguments, which every user of the host can read
            page.url = _url(command, process.stdout.readline())
            yield page
        finally:
            page.faults = _end(process)


@contextmanager
def page_beside(
    at: PageAddress, endpoints: tuple[str, str], scenario: Scenario, err: Console, zenoh: ZenohOptions, reports: bool
) -> Iterator[PageProcess]:
    """Serve the page during the block; print its address, and its faults afterwards. A report may follow."""
    page: PageProcess | None = None
    try:
        with page_process(
            "tis run --view",
            at,
            endpoints,
            scenario.session,
            beside=True,
            zenoh=zenoh,
            scenario=scenario,
            secret=secret_of(scenario.security),
            reports=reports,
        ) as page:
            announce(page.url, err)
            yield page
    finally:
        for fault in page.faults if page else ():
            err.print(f"live page: {fault}", style="yellow", soft_wrap=True, markup=False)


def _url(command: str, line: str) -> str:
    """Return the address in the process's first line; raises the faults reported there instead."""
    message: dict[str, Any] = json.loads(line) if line else {}
    if "url" in message:
        return str(message["url"])
    if "faults" in message:
        raise InputError([Fault("", "", text) for text in message["faults"]])
    raise PeerError(Fault(command, "", "the page's process ended before it could be opened"))


def _end(process: "subprocess.Popen[str]") -> list[str]:
    """End the page's process; return its faults."""
    assert process.stdout is not None
    end_by_input(process, _GRACE_S)
    return [str(fault) for line in process.stdout for fault in json.loads(line).get("faults", [])]


_POLL_S = 0.2


def attach_page(
    given: tuple[str | None, str | None], prefix: str | None, zenoh: ZenohOptions, at: PageAddress,
    wait_s: float | None, err: Console, secret: Path | None = None,
) -> int:  # fmt: skip
    """Serve the page until the end of the run or of the netem, or until Ctrl-C; return the exit code.

    ``secret`` is the file of the run's secret, by which the page signs. Without an endpoint ``given``, it is that of
    what runs on this machine, present or future; one of several has to be named. Raises `InputError` without Bokeh,
    for an unusable address, secret or Zenoh option, `PeerError` when netem does not answer.
    """
    client_identity(configure("client", zenoh), secret)
    interrupt = Interrupt()
    with interrupt.installed(), ExitStack() as stack:
        if given == (None, None):
            here = _awaited(prefix, wait_s, interrupt, err)
        else:
            here = Running(given[0] or WEST, given[1] or EAST, prefix or Running().session)
        if here is None:
            return EXIT_INTERRUPTED
        page = stack.enter_context(
            page_process("tis view", at, (here.west, here.east), here.session, wait_s, zenoh=zenoh, secret=secret)
        )
        announce(page.url, err)
        waits = f" with prefix {here.session}, for which it waits" if given != (None, None) else ""
        err.print(f"of netem at {here.west} and {here.east}{waits}", style="dim", soft_wrap=True)
        while page.process.poll() is None and not interrupt.requested:
            try:
                page.process.wait(_POLL_S)
            except subprocess.TimeoutExpired:
                continue
    if page.faults:
        raise PeerError([Fault("", "", fault) for fault in page.faults])
    if interrupt.requested:
        return EXIT_INTERRUPTED
    err.print("it is over")
    return EXIT_OK


def _awaited(prefix: str | None, wait_s: float | None, interrupt: Interrupt, err: Console) -> Running | None:
    """Wait for a run or a netem on this machine; return it, None after an interrupt; raises `PeerError` in time."""
    until_s = inf if wait_s is None else time.monotonic() + wait_s
    said = False
    while (here := running_here("tis view", ("--west", "--east"), prefix)) is None:
        if not said:
            said = True
            text = f"no run on this machine yet: waiting for tis run, or for netem at {WEST}; Ctrl-C ends it"
            err.print(text, style="dim", soft_wrap=True)
        if interrupt.requested:
            return None
        if time.monotonic() > until_s:
            raise PeerError(Fault("tis view", WEST, f"no answer from a run within {wait_s} s"))
        time.sleep(_POLL_S)
    err.print(f"found: {here.title}", style="dim", soft_wrap=True)
    return here
