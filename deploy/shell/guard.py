"""How every command ends: an exit code, one line for each fault of the user's, a traceback for ours.

When whoever reads the output goes away, as `head` does, rich and typer both end in silence with exit code 1.
"""

import select
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from typing import Final, ParamSpec

import typer
from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_BUG, EXIT_INTERRUPTED, DataError, Fault, TisError

# without emoji, or module:X: in a fault would become one
OUT: Final = Console(highlight=False, emoji=False)
ERR: Final = Console(stderr=True, highlight=False, emoji=False)

P = ParamSpec("P")


def guarded(command: Callable[P, int]) -> Callable[P, None]:
    """Turn errors into one line each and an exit code; a bug keeps its traceback."""

    @wraps(command)
    def ending(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            code = command(*args, **kwargs)
            sys.stdout.flush()  # while a reader that went away can still be told from a full disk
        except TisError as error:
            for fault in error.faults:
                ERR.print(escape(f"tis: {fault}"), style="red", soft_wrap=True)
            code = error.exit_code
        except OSError as error:
            if isinstance(error, BrokenPipeError) and _nobody_reads():
                raise  # which typer takes for the end, without a word
            fault = Fault(str(error.filename or "disk"), "", error.strerror or str(error))
            ERR.print(escape(f"tis: {fault}"), style="red", soft_wrap=True)
            code = DataError.exit_code
        except KeyboardInterrupt:
            code = EXIT_INTERRUPTED
        except Exception as error:
            traceback.print_exc()
            ERR.print(escape(f"tis: bug: {type(error).__name__}: {error}"), style="red", soft_wrap=True)
            code = EXIT_BUG
        raise typer.Exit(code)

    return ending


def _nobody_reads() -> bool:
    """Tell whether the output is a pipe that nobody reads any more."""
    with suppress(OSError, ValueError):  # an output that is no file
        poll = select.poll()
        poll.register(sys.stdout.fileno(), 0)
        return any(event & select.POLLERR for _, event in poll.poll(0))
    return False
