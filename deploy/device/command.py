"""Command `tis device`: the mouse or a gamepad of this host, as the device of a live source."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final, get_args

import zenoh

from tis.common.errors import EXIT_OK, Fault, InputError, PeerError
from tis.common.messages import encode
from tis.common.runtime.connections import closing
from tis.common.runtime.control import ControlKeys
from tis.common.runtime.process import Interrupt, child_environment
from tis.common.runtime.side_cli import endpoints_for
from tis.common.runtime.side_log import SideOptions
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_S
from tis.deploy.device.inputs import COMMAND, Inputs, Kind, close_inputs, open_inputs

_END_S: Final = 5.0


@contextmanager
def device_beside(scenario: Scenario, options: SideOptions) -> Iterator[None]:
    """Run the device that the options name, if any, until the end of the block; raises `InputError`.

    What it lacks (extra, display, gamepad, a live source) is said before anything is started.
    """
    if options.device is None:
        yield
        return
    source, kind = scenario.source, options.device
    if source.kind != "live":
        rule = "needs a scenario whose source is live"
        raise InputError(Fault(f"scenario {scenario.name}", "source.kind", rule, source.kind))
    assert kind in get_args(Kind)
    close_inputs(open_inputs(kind))  # type: ignore[arg-type]
    connect = options.zenoh.connect or endpoints_for(scenario, "surgeon", "west")
    command = [sys.executable, "-m", "tis.deploy.cli.main", "device", kind, "--key", source.keys.of(source.hands[0])]
    command += ["--session", scenario.session, *(word for one in connect for word in ("--connect", one))]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, env=child_environment())
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def run_device(
    kind: Kind, connect: Sequence[str], key: str, rate_hz: int, session: str, say: Callable[[str], None],
    wait_s: float | None = None,
) -> int:  # fmt: skip
    """Publish the handle's poses on ``key`` until the window is closed or the run is over; return the exit code.

    Raises `InputError` without the extra, a display or a gamepad, `PeerError` when netem is not there in time.
    """
    inputs, interrupt = open_inputs(kind), Interrupt()
    until_s = None if wait_s is None else time.monotonic() + wait_s
    try:
        with interrupt.installed():
            config = configure("client", ZenohOptions(connect=tuple(connect)))
            zenoh_session = open_client(
                config,
                lambda: interrupt.requested or (until_s is not None and time.monotonic() > until_s),
                lambda: say(f"waiting for netem at {', '.join(connect)}"),
            )
            if zenoh_session is None:
                if interrupt.requested:
                    return EXIT_OK
                raise PeerError(Fault(COMMAND, "--connect", f"netem did not answer within {wait_s} s", list(connect)))
            with closing(zenoh_session, config):
                n_sent = _publish(inputs, zenoh_session, key, rate_hz, session, interrupt)
    finally:
        close_inputs(inputs)
    say(f"{n_sent} poses sent on {key}")
    return EXIT_OK


def _publish(inputs: Inputs, session: zenoh.Session, key: str, rate_hz: int, name: str, interrupt: Interrupt) -> int:
    over = threading.Event()

    def noticed(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            over.set()

    watch = session.liveliness().declare_subscriber(ControlKeys(name).run("netem", "*"), noticed, history=True)
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
    n_sent, before_ns = 0, time.monotonic_ns()
    while not (over.is_set() or inputs.is_over or interrupt.requested):
        stamp_ns = time.monotonic_ns()
        handle = inputs.read(stamp_ns - before_ns)
        before_ns = stamp_ns
        publisher.put(encode(handle.pose(stamp_ns)))
        n_sent += 1
        over.wait(max(0.0, (stamp_ns + NS_PER_S // rate_hz - time.monotonic_ns()) / NS_PER_S))
    watch.undeclare()  # type: ignore[no-untyped-call]
    return n_sent
