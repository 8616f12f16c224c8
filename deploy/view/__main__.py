"""The page's process: ``python -m deploy.view OPTIONS_AS_JSON``, started by ``tis run --view`` and by ``tis view``.

It prints one line of JSON when the page can be opened, or when it cannot. On its standard input a line of JSON may
tell what the run has left behind; the process ends when that input is closed, which happens however its parent ends.
"""

import json
import os
import sys
import threading
from typing import Final

from common.errors import EXIT_BUG, EXIT_OK, TisError
from common.runtime.interrupt import Interrupt
from deploy.view.page_text import Left
from deploy.view.server import ViewOptions, serve

_NICENESS: Final = 10
_MOST: Final = 1 << 16


def main(text: str) -> int:
    """Serve the page; return the exit code."""
    given = json.loads(text)
    options = ViewOptions(**{**given, "hosts": tuple(given["hosts"]), "cfg": tuple(given.get("cfg", ()))})
    os.nice(_NICENESS)  # whoever watches comes after the run itself
    interrupt = Interrupt()
    orphaned = threading.Event()

    told: list[Left] = []

    def hear_parent() -> None:
        heard = b""
        try:
            while some := os.read(sys.stdin.fileno(), _MOST):  # unbuffered: a lock would be held at the end
                *lines, heard = (heard + some).split(b"\n")
                told.extend(Left(**json.loads(line)) for line in lines)
        finally:
            orphaned.set()

    threading.Thread(target=hear_parent, name="parent", daemon=True).start()
    with interrupt.installed():
        try:
            serve(
                options, lambda url: _say({"url": url}), lambda: interrupt.requested or orphaned.is_set(),
                lambda: told[-1] if told else None,
            )  # fmt: skip
        except TisError as error:
            _say({"faults": [str(fault) for fault in error.faults]})
            return error.exit_code
        except Exception as error:
            _say({"faults": [f"bug: {type(error).__name__}: {error}"]})
            return EXIT_BUG
    return EXIT_OK


def _say(content: dict[str, object]) -> None:
    print(json.dumps(content), flush=True)  # noqa: T201  (standard output is what the parent reads)


if __name__ == "__main__":
    code = main(sys.argv[1])
    sys.stdout.flush()
    # Threads of Zenoh's may still be letting go of callbacks, which the end of the interpreter turns into an abort.
    os._exit(code)
