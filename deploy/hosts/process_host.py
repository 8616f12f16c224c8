"""Hosts on this machine: a network namespace, or the machine itself."""

import asyncio
import contextlib
import os
import shlex
import shutil
import signal
from collections.abc import Sequence
from typing import Final

from common.errors import Fault, PeerError
from common.runtime.clock_skew import SKEW_VARIABLE
from deploy.hosts.host import RemoteProcess
from deploy.hosts.hosts_file import LocalHost, NamespaceHost

_NO_IP: Final = "/usr/sbin/ip"


class ProcessHost:
    """Starts `tis` as a process of this machine."""

    def __init__(self, settings: NamespaceHost | LocalHost) -> None:
        self.place = settings.place
        self._words = [*_prefix(settings), *(os.path.expanduser(word) for word in shlex.split(settings.tis))]  # noqa: PTH111
        self._skew = {} if settings.clock_skew is None else {SKEW_VARIABLE: settings.clock_skew}

    async def open(self) -> None:
        """Nothing has to be connected."""

    async def start(self, *words: str) -> RemoteProcess:
        """Start ``tis``; raises `PeerError`."""
        pipe = asyncio.subprocess.PIPE
        try:
            # A session of its own: Ctrl-C reaches `tis up` only, which then ends the sides in order.
            process = await asyncio.create_subprocess_exec(
                *self._words, *words, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True,
                env={**os.environ, **self._skew},
            )  # fmt: skip
        except OSError as error:
            rule = f"`{self._words[0]}` cannot be started: {error.strerror}"
            raise PeerError(Fault(self.place, "", rule)) from None
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None

        def kill() -> None:
            # not process.kill(): it polls, and so takes the exit code from asyncio, which then warns
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGKILL)

        return RemoteProcess(process.stdin, process.stdout, process.stderr, process.wait, kill)

    async def close(self) -> None:
        """Nothing is connected."""


def _prefix(settings: NamespaceHost | LocalHost) -> Sequence[str]:
    if settings.kind == "local":
        return ()
    return (shutil.which("ip") or _NO_IP, "netns", "exec", settings.namespace)
