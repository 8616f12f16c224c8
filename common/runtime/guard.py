"""The guard around every command: an exit code, the faults of the user, a traceback for a bug of ours."""

import select
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress

from tis.common.errors import EXIT_BUG, EXIT_INTERRUPTED, DataError, Fault, TisError


def guarded_exit_code(name: str, run: Callable[[], int], failed: Callable[[int, Sequence[Fault]], None]) -> int:
    """Return the exit code of ``run``, which reports no error of its own.

    Parameters
    ----------
    name
        The command; it stands in place of a file where an error of the system names none.
    run
        The command's work; returns its exit code.
    failed
        Reports the exit code and the faults. A bug's traceback is on standard error before.

    Raises
    ------
    BrokenPipeError
        When the reader of standard output has gone away, as `head` does: typer ends silently with exit code 1.
    """
    try:
        code = run()
        sys.stdout.flush()  # now, while a reader that went away can be told from a full disk
        return code
    except TisError as error:
        code, faults = error.exit_code, list(error.faults)
    except OSError as error:
        if isinstance(error, BrokenPipeError) and _reader_is_gone():
            raise
        code, faults = DataError.exit_code, [Fault(str(error.filename or name), "", error.strerror or str(error))]
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except Exception as error:
        traceback.print_exc()
        code, faults = EXIT_BUG, [Fault(name, "", f"bug: {type(error).__name__}: {error}")]
    failed(code, faults)
    return code


def line_of(name: str, fault: Fault) -> str:
    """Return the line that reports ``fault``, which begins with the command's name."""
    return str(fault) if fault.where == name else f"{name}: {fault}"


def _reader_is_gone() -> bool:
    """Tell whether standard output is a pipe without a reader."""
    with suppress(OSError, ValueError):  # an output that is no file
        poll = select.poll()
        poll.register(sys.stdout.fileno(), 0)
        return any(event & select.POLLERR for _, event in poll.poll(0))
    return False
