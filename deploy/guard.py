"""How every command ends: an exit code, one line for each fault of the user's, a traceback for ours."""

import traceback
from collections.abc import Callable
from functools import wraps
from typing import Final, ParamSpec

import typer
from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_BUG, EXIT_INTERRUPTED, DataError, Fault, TisError

OUT: Final = Console(highlight=False)
ERR: Final = Console(stderr=True, highlight=False)

P = ParamSpec("P")


def guarded(command: Callable[P, int]) -> Callable[P, None]:
    """Turn errors into one line each and an exit code; a bug keeps its traceback."""

    @wraps(command)
    def ending(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            code = command(*args, **kwargs)
        except TisError as error:
            for fault in error.faults:
                ERR.print(escape(f"tis: {fault}"), style="red", soft_wrap=True)
            code = error.exit_code
        except OSError as error:
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
