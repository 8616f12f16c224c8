"""The end of a process that has talked over Zenoh."""

import atexit
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress


def run_to_end(main: Callable[[], object]) -> None:
    """Run ``main`` and end the process with its exit code; once Zenoh was loaded, without finalising the interpreter.

    Zenoh's threads outlive its sessions. One that still wants the interpreter, or runs through the exit handlers of
    the C library, aborts the whole process: `tis run` ended with SIGABRT instead of its exit code, rarely and on a
    busy machine only. Threads of ours are joined, exit handlers called and outputs flushed before.
    """
    try:
        main()
        code = 0
    except SystemExit as ended:
        if "zenoh" not in sys.modules:
            raise
        code = _number(ended.code)
    if "zenoh" not in sys.modules:
        return
    # what the interpreter calls, in its order: pools of threads are told to end before threads are joined
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # a reader that has gone away
            stream.flush()
    os._exit(code)


def _number(code: object) -> int:
    if code is None:
        return 0
    if isinstance(code, int):
        return code & 0xFF
    sys.stderr.write(f"{code}\n")
    return 1
