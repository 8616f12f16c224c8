"""Command `tis device`: the mouse or a gamepad of this host, as the device of a live source."""

import threading
import time
from collections.abc import Callable, Sequence

import zenoh

from tis.common.errors import EXIT_OK, Fault, PeerError
from tis.common.runtime.control import ControlKeys
from tis.common.runtime.process import Interrupt
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client
from tis.common.units import NS_PER_S
from tis.deploy.device.inputs import COMMAND, Inputs, Kind, close_inputs, open_inputs


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
            zenoh_session = open_client(
                configure("client", ZenohOptions(connect=tuple(connect))),
                lambda: interrupt.requested or (until_s is not None and time.monotonic() > until_s),
                lambda: say(f"waiting for netem at {', '.join(connect)}"),
            )
            if zenoh_session is None:
                if interrupt.requested:
                    return EXIT_OK
                raise PeerError(Fault(COMMAND, "--connect", f"netem did not answer within {wait_s} s", list(connect)))
            with zenoh_session:
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
        publisher.put(handle.pose(stamp_ns).model_dump_json())
        n_sent += 1
        over.wait(max(0.0, (stamp_ns + NS_PER_S // rate_hz - time.monotonic_ns()) / NS_PER_S))
    watch.undeclare()  # type: ignore[no-untyped-call]
    return n_sent
