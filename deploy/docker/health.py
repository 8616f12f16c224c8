"""Health check of a side's container: a log that has begun to grow must go on growing.

A side writes its log twice a second once the run has begun. While it waits for the others its log holds little more
than the scenario. Logs of before this container's start do not count.
"""

import sys
import time
from pathlib import Path

MAX_AGE_S = 10.0
BEGUN_BYTES = 32_768


def is_healthy(runs: Path, started_s: float, now_s: float) -> bool:
    """Tell whether the newest log that has grown since ``started_s`` was written within the last ten seconds."""
    found = (log.stat() for log in runs.rglob("*.mcap"))
    written_s = [one.st_mtime for one in found if one.st_mtime >= started_s and one.st_size >= BEGUN_BYTES]
    return not written_s or now_s - max(written_s) <= MAX_AGE_S


if __name__ == "__main__":
    sys.exit(0 if is_healthy(Path("/runs"), Path("/proc/1").stat().st_ctime, time.time()) else 1)
