"""Time and memory of a command run as a child process, including its own children."""

import os
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tis.common.runtime.process import child_environment

_LOOK_EVERY_S: Final = 0.05
_MB: Final = 1e-6


@dataclass(frozen=True)
class Usage:
    """Resources of a command: wall time, CPU time and peak memory."""

    exit_code: int
    wall_s: float
    cpu_s: float
    peak_mb: float


def measure(command: Sequence[str]) -> Usage:
    """Run a command and discard its output.

    The memory is the largest sum of the resident sizes of its processes, sampled 20 times a second. Shared pages
    count for each process. The kernel's own peak (ru_maxrss) is unusable: a child inherits its parent's.
    """
    begun_s = time.perf_counter()
    child = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=child_environment(),
    )
    over = threading.Event()
    found = [0]
    watcher = threading.Thread(target=_watch, args=(child.pid, over, found), name="memory", daemon=True)
    watcher.start()
    _, status, usage = os.wait4(child.pid, 0)
    wall_s = time.perf_counter() - begun_s
    child.returncode = os.waitstatus_to_exitcode(status)
    over.set()
    watcher.join()
    return Usage(child.returncode, wall_s, usage.ru_utime + usage.ru_stime, max(found) * _MB)


def resident_bytes(pid: int) -> int:
    """Return the resident memory of a process and all its descendants; 0 when it has ended."""
    total, waiting = 0, [pid]
    page_bytes = os.sysconf("SC_PAGE_SIZE")
    while waiting:
        process = Path("/proc") / str(waiting.pop())
        try:
            total += int((process / "statm").read_text().split()[1]) * page_bytes
            for thread in (process / "task").iterdir():
                waiting += map(int, (thread / "children").read_text().split())
        except (OSError, IndexError):
            continue  # it has ended meanwhile
    return total


def _watch(pid: int, over: threading.Event, found: list[int]) -> None:
    while not over.wait(_LOOK_EVERY_S):
        found.append(resident_bytes(pid))
