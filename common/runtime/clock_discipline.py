"""State of the host's clock discipline, by a read-only call of adjtimex."""

import ctypes
import sys
from typing import Final

from tis.common.host_records import DisciplineNote

_STA_UNSYNC: Final = 0x0040
_TIME_ERROR: Final = 5
_SCALED_PPM: Final = 1 << 16


class _Timex(ctypes.Structure):
    """``struct timex`` of <sys/timex.h>."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        *((name, ctypes.c_long) for name in ("offset", "freq", "maxerror", "esterror")),
        ("status", ctypes.c_int),
        *((name, ctypes.c_long) for name in ("constant", "precision", "tolerance", "seconds", "fraction", "tick")),
        *((name, ctypes.c_long) for name in ("ppsfreq", "jitter")),
        ("shift", ctypes.c_int),
        *((name, ctypes.c_long) for name in ("stabil", "jitcnt", "calcnt", "errcnt", "stbcnt")),
        ("tai", ctypes.c_int),
        ("padding", ctypes.c_int * 11),
    )


def read_discipline(at_ns: int) -> DisciplineNote | None:
    """Return the state of the clock discipline, read at run time ``at_ns``; None where it is not available."""
    call = getattr(ctypes.CDLL(None), "adjtimex", None) if sys.platform.startswith("linux") else None
    if call is None:
        return None
    timex = _Timex(modes=0)  # 0: read only, which needs no privilege
    state = call(ctypes.byref(timex))
    if state < 0:
        return None
    return DisciplineNote(
        at_ns=at_ns,
        synchronised=state != _TIME_ERROR and not timex.status & _STA_UNSYNC,
        estimated_error_us=timex.esterror,
        maximum_error_us=timex.maxerror,
        frequency_ppm=timex.freq / _SCALED_PPM,
    )
