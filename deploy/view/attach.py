"""Command `tis view`: the live page on a run started elsewhere."""

import subprocess

from rich.console import Console

from tis.common.errors import EXIT_INTERRUPTED, EXIT_OK, Fault, PeerError
from tis.common.runtime.process import Interrupt
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.deploy.view.page_process import PageAddress, announce, page_process

_POLL_S = 0.2


def attach_page(
    endpoints: tuple[str, str], prefix: str, zenoh: ZenohOptions, at: PageAddress, wait_s: float | None, err: Console
) -> int:  # fmt: skip
    """Serve the page until the end of the run, or until Ctrl-C; return the exit code.

    Raises `InputError` without Bokeh, for an unusable address or invalid Zenoh options, `PeerError` when netem does
    not answer.
    """
    configure("client", zenoh)
    interrupt = Interrupt()
    with interrupt.installed(), page_process("tis view", at, endpoints, prefix, wait_s, zenoh=zenoh) as page:
        announce(page.url, err)
        while page.process.poll() is None and not interrupt.requested:
            try:
                page.process.wait(_POLL_S)
            except subprocess.TimeoutExpired:
                continue
    if page.faults:
        raise PeerError([Fault("", "", fault) for fault in page.faults])
    if interrupt.requested:
        return EXIT_INTERRUPTED
    err.print("the run is over")
    return EXIT_OK
