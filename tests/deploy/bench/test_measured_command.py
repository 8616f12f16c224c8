"""What a command took, of children whose memory and end are known."""

import sys

from tis.deploy.bench.measured_command import measure

MB = 1_000_000
HOLD = f"x = bytearray({100 * MB}); x[::1000] = b'x' * len(x[::1000])"
BOTH = f"{HOLD}; import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]], check=True)"


def test_the_memory_is_that_of_all_its_processes_together() -> None:
    """100 MB here and 100 MB in a child, held for half a second; an interpreter alone takes some 10 MB."""
    child = f"{HOLD}; import time; time.sleep(0.5)"
    found = measure([sys.executable, "-c", BOTH, child])
    assert found.exit_code == 0
    assert 200 < found.peak_mb < 300
    assert found.wall_s >= 0.5


def test_whoever_measures_may_be_large_itself() -> None:
    """This process holds 300 MB while it starts one of 100 MB."""
    here = bytearray(300 * MB)
    here[::1000] = b"x" * len(here[::1000])
    found = measure([sys.executable, "-c", f"{HOLD}; import time; time.sleep(0.5); raise SystemExit(7)"])
    assert found.exit_code == 7
    assert 100 < found.peak_mb < 150
