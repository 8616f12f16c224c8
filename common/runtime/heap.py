"""How the C library keeps the memory of large arrays."""

import ctypes
from typing import Final

_M_MMAP_THRESHOLD: Final = -3
_LARGE_BYTES: Final = 2 * 1024 * 1024


def give_back_large_arrays() -> None:
    """Let arrays of 2 MB and more be mapped one by one, so that the system has their room back when they are freed.

    glibc's own limit rises to 32 MB with use, and arrays below it leave holes: a sixth of what summing up ten minutes
    at 1 kHz takes. Elsewhere without effect.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
