"""Memory settings: for bulk work on millions of objects and large arrays, and for runs that last for hours."""

import ctypes
import gc
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

_M_MMAP_THRESHOLD: Final = -3  # of mallopt(3)
_M_ARENA_MAX: Final = -8
_N_ARENAS: Final = 2
_GROWN: Final = 1.02
_REST_S: Final = 10.0
_STATM: Final = Path("/proc/self/statm")
_LARGE_BYTES: Final = 2 * 1024 * 1024
_PASSING_BYTES: Final = 128 * 1024
"""Glibc's own threshold before it adapts: batches for the log, chunks and their compressed form are larger."""


@contextmanager
def without_collector() -> Iterator[None]:
    """Switch the cyclic garbage collector off within the block; it would add 10 to 17 % where nothing has cycles."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def release_large_arrays() -> None:
    """Map arrays of 2 MB and more separately, so that their memory returns to the system when they are freed.

    glibc raises its own threshold up to 32 MB with use; smaller arrays then leave holes, a sixth of the memory for
    the summary of ten minutes at 1 kHz. Other C libraries: no effect.
    """
    _call("mallopt", _M_MMAP_THRESHOLD, _LARGE_BYTES)


def share_arenas() -> None:
    """Let all threads that start from now on take memory from two arenas.

    What one thread frees another can use then: Zenoh and the recorder have a dozen threads, of which each would
    keep the memory of its own worst moment.
    """
    _call("mallopt", _M_ARENA_MAX, _N_ARENAS)


def keep_heap_level() -> None:
    """Return free memory to the system now, and map blocks of 128 kB and more separately from now on.

    What a log needs for a moment would otherwise lie between what stays: at 1 kHz with two hands netem grew by a
    tenth in 20 minutes, now by 3 % in 30; what the patient returns at once is a third of its memory.
    """
    _call("mallopt", _M_MMAP_THRESHOLD, _PASSING_BYTES)
    _call("malloc_trim", 0)


def resident_bytes() -> int:
    """Return the resident memory of this process; 0 where the system does not tell."""
    try:
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


class LevelHeap:
    """Returns free memory to the system once the process has grown: what a burst or a freeze took for a moment.

    ``resident`` returns the resident bytes, ``trim`` returns what is free. Looking costs 10 us, trimming below a
    millisecond, and several where much is returned: it happens after a growth of 2 %, and once in 10 s at most.
    """

    def __init__(
        self,
        resident: Callable[[], int] = resident_bytes,
        trim: Callable[[], object] = lambda: _call("malloc_trim", 0),
    ) -> None:
        self._resident, self._trim = resident, trim
        self._level_bytes = resident()
        self._next_s = 0.0

    def look(self, now_s: float | None = None) -> None:
        """Trim if it is time to; ``now_s`` is the time on the monotonic clock."""
        now_s = time.monotonic() if now_s is None else now_s
        if now_s < self._next_s or self._resident() <= _GROWN * self._level_bytes:
            return
        self._trim()
        self._level_bytes, self._next_s = self._resident(), now_s + _REST_S


def _call(name: str, *arguments: int) -> None:
    """Call a function of glibc; other C libraries are left alone. Setting the threshold stops glibc's adapting."""
    function = getattr(ctypes.CDLL(None), name, None)
    if function is not None:
        function(*arguments)
