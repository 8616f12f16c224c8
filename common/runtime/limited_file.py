"""Files read up to a limit of size, whatever they are."""

import errno
from pathlib import Path


def read_limited(path: Path, max_bytes: int) -> bytes:
    """Return the content of a file; raises `OSError`, also for one of more than ``max_bytes``.

    The size that the system states would not do: a device states none.
    """
    with path.open("rb") as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"it has more than {max_bytes} bytes", str(path))
    return content
