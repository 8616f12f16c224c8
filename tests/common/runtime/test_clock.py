import ctypes
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tis.common.errors import InputError
from tis.common.runtime.clock import skewed
from tis.common.runtime.clock_watch import _Timex, read_discipline

_ROOT = Path(__file__).resolve().parents[3]


def test_a_wrapped_clock_is_ahead_and_fast_by_what_was_asked() -> None:
    shown = skewed("3:50", lambda: 10**12)
    assert shown() == 10**12 + 3 * 10**9 + 50 * 10**6
    assert skewed("-0.5:-20", lambda: 10**12)() == 10**12 - 5 * 10**8 - 20 * 10**6


@pytest.mark.parametrize(
    "text", ["", "3", "3:", ":50", "a:b", "3:50:1", "nan:0", "inf:0", "0:inf", "0:1e6", "1e300:0:"]
)
def test_what_cannot_be_read_is_said_at_the_first_reading(text: str) -> None:
    shown = skewed(text, lambda: 0)
    with pytest.raises(InputError, match="TIS_CLOCK_SKEW: must read OFFSET_S:DRIFT_PPM"):
        shown()


def test_the_environment_makes_a_process_another_host() -> None:
    """Its clock is 3600 s ahead, to within what starting takes, and its boot id another one."""
    code = "from tis.common.runtime.clock import *; print(monotonic_ns(), WallClock(0).now_ns(), boot_id(), sep='|')"
    said = []
    for skew in ({}, {"TIS_CLOCK_SKEW": "3600:0"}):
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=_ROOT,
            env={**os.environ, **skew},
            capture_output=True,
            text=True,
            check=True,
        )
        said.append(done.stdout.strip().split("|"))
    true, wrong = said
    assert true[2] != wrong[2]
    for i in (0, 1):
        assert 0 < int(wrong[i]) - int(true[i]) - 3600 * 10**9 < 600 * 10**9


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="adjtimex is Linux's")
def test_the_kernel_says_how_it_keeps_the_clock() -> None:
    """``struct timex`` has 208 bytes on every 64-bit Linux; the errors are at most 16 s there, the rate 512 ppm."""
    if ctypes.sizeof(ctypes.c_long) == 8:
        assert ctypes.sizeof(_Timex) == 208
    note = read_discipline(7)
    if note is None:
        pytest.skip("this kernel cannot be asked")
    assert note.at_ns == 7
    assert note.estimated_error_us >= 0
    assert note.maximum_error_us >= 0
    assert -512 <= note.frequency_ppm <= 512
