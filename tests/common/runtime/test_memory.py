"""Large arrays return their memory, by glibc's count of mapped blocks in child processes; the collector's state."""

import ctypes
import gc
import subprocess
import sys
from pathlib import Path

import pytest

from tis.common.runtime.memory import LevelHeap, keep_heap_level, release_large_arrays, without_collector

_ROOT = Path(__file__).resolve().parents[3]
_MB = 1024 * 1024
_COUNT = """
import ctypes
import sys

class Info(ctypes.Structure):  # struct mallinfo2, malloc.h
    _fields_ = [(name, ctypes.c_size_t) for name in
                ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks",
                 "keepcost")]

libc = ctypes.CDLL(None)
libc.mallinfo2.restype = Info
libc.malloc.restype = ctypes.c_void_p
libc.malloc.argtypes = [ctypes.c_size_t]
libc.free.argtypes = [ctypes.c_void_p]
if sys.argv[1] != "without":
    from tis.common.runtime import memory
    getattr(memory, sys.argv[1])()
libc.free(libc.malloc(16 << 20))  # from here on glibc by itself maps only what is larger than 16 MB
before = libc.mallinfo2()
block = libc.malloc(int(sys.argv[2]))
held = libc.mallinfo2()
libc.free(block)
after = libc.mallinfo2()
print(held.hblks - before.hblks, held.hblkhd - before.hblkhd, after.hblks - before.hblks)
"""

_counted = pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="glibc 2.33 or later counts its mapped blocks"
)


def _mapped(how: str, n_bytes: int) -> tuple[int, int, int]:
    """Return by how many blocks and bytes an allocation adds to what is mapped, and what stays when it is freed."""
    done = subprocess.run(
        [sys.executable, "-c", _COUNT, how, str(n_bytes)], cwd=_ROOT, capture_output=True, text=True, check=True
    )
    n_blocks, size_bytes, n_left = map(int, done.stdout.split())
    return n_blocks, size_bytes, n_left


@_counted
def test_an_array_of_2_mb_is_mapped_alone_and_gone_when_freed_even_after_larger_ones() -> None:
    n_blocks, size_bytes, n_left = _mapped("release_large_arrays", 2 * _MB)
    assert (n_blocks, n_left) == (1, 0)
    assert 2 * _MB <= size_bytes <= 2 * _MB + 16 * 1024


@_counted
def test_smaller_ones_stay_on_the_heap() -> None:
    assert _mapped("release_large_arrays", _MB) == (0, 0, 0)


@_counted
def test_during_a_run_what_a_log_needs_for_a_moment_is_mapped_alone() -> None:
    n_blocks, _, n_left = _mapped("keep_heap_level", 128 * 1024)
    assert (n_blocks, n_left) == (1, 0)
    assert _mapped("keep_heap_level", 64 * 1024) == (0, 0, 0)


@_counted
def test_glibc_by_itself_would_not_map_it() -> None:
    """What the function is for; without this the first test would prove nothing."""
    assert _mapped("without", 2 * _MB) == (0, 0, 0)


def test_a_c_library_without_mallopt_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def without_mallopt(name: object) -> object:
        asked.append(name)
        return object()

    monkeypatch.setattr(ctypes, "CDLL", without_mallopt)
    release_large_arrays()
    keep_heap_level()
    assert asked == [None, None, None]


def test_what_a_burst_took_is_returned_once_in_ten_seconds_and_not_for_a_little() -> None:
    resident, trimmed = [100_000_000], list[float]()

    def look(now_s: float, n_bytes: int) -> None:
        resident[0] = n_bytes
        heap.look(now_s)

    def trim() -> None:
        trimmed.append(resident[0])
        resident[0] = 100_500_000

    heap = LevelHeap(lambda: resident[0], trim)
    look(1.0, 101_900_000)
    assert trimmed == []
    look(2.0, 110_000_000)
    assert trimmed == [110_000_000]
    look(11.9, 120_000_000)
    assert len(trimmed) == 1
    look(12.0, 102_400_000)  # less than 2 % above what was left
    assert len(trimmed) == 1
    look(12.5, 103_000_000)
    assert trimmed == [110_000_000, 103_000_000]


@_counted
def test_a_burst_of_a_process_returns_to_the_system() -> None:
    program = """
from tis.common.runtime.memory import LevelHeap, resident_bytes
heap = LevelHeap()
before = resident_bytes()
kept = [bytes(3000) for _ in range(20_000)]
del kept[1::2], kept[:-1]  # free but for one block at the top of the heap
grown = resident_bytes()
heap.look()
print(before, grown, resident_bytes())
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=_ROOT, capture_output=True, text=True, check=True)
    before, grown, after = map(int, done.stdout.split())
    assert grown - before > 50 * _MB
    assert after - before < 5 * _MB


@pytest.mark.parametrize("was_on", [True, False])
def test_the_collector_is_off_within_and_as_before_afterwards(was_on: bool) -> None:
    before = gc.isenabled()
    try:
        (gc.enable if was_on else gc.disable)()
        with without_collector():
            within = gc.isenabled()
        assert not within
        assert gc.isenabled() == was_on
        with pytest.raises(ZeroDivisionError), without_collector():
            raise ZeroDivisionError
        assert gc.isenabled() == was_on
    finally:
        (gc.enable if before else gc.disable)()
