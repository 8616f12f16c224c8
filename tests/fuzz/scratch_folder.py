"""Folders of the files that decoders read: in memory where possible, and removed when the process ends."""

import atexit
import shutil
import tempfile
from pathlib import Path

_MEMORY = Path("/dev/shm")


def scratch_folder() -> Path:
    """Return a new folder of this process."""
    path = Path(tempfile.mkdtemp(prefix="tis_fuzz_", dir=_MEMORY if _MEMORY.is_dir() else None))
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path
