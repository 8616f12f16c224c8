"""A device as a process beside the surgeon's: `tis surgeon --device`."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, get_args

from tis.common.errors import Fault, InputError
from tis.common.runtime.process import child_environment
from tis.common.runtime.side_cli import endpoints_for
from tis.common.runtime.side_log import SideOptions
from tis.common.scenario import Scenario
from tis.deploy.device.inputs import Kind, close_inputs, open_inputs

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
