"""Process of the live page: ``python -m deploy.view OPTIONS_AS_JSON``, child of ``tis run --view`` or ``tis view``.

It prints one line of JSON with the page's address or with faults. On its standard input a line of JSON may name the
run's output. The process ends when that input is closed, which happens however its parent ends.
"""

import json
import os
import sys
import threading
from typing import Final

from common.errors import EXIT_BUG, EXIT_OK, TisError
from common.runtime.interrupt import Interrupt
from deploy.view.page_text import RunOutput
from deploy.view.server import ViewOptions, serve

_NICENESS: Final = 10
_READ_BYTES: Final = 1 << 16


def main(text: str) -> int:
    """Serve the page; return the exit code."""
    content = json.loads(text)
    options = ViewOptions(**{**content, "hosts": tuple(content["hosts"]), "cfg": tuple(content.get("cfg", ()))})
    os.nice(_NICENESS)  # the run itself has priority
    interrupt = Interrupt()
    parent_gone = threading.Event()

    outputs: list[RunOutput] = []

    def read_parent() -> None:
        partial = b""
        try:
            while some := os.read(
                sys.stdin.fileno(), _READ_BYTES
            ):  # unbuffered: a buffer's lock would block the exit
                *lines, partial = (partial + some).split(b"\n")
                outputs.extend(RunOutput(**json.loads(line)) for line in lines)
        finally:
            parent_gone.set()

    threading.Thread(target=read_parent, name="parent", daemon=True).start()
    with interrupt.installed():
        try:
            serve(
                options, lambda url: _print_json({"url": url}), lambda: interrupt.requested or parent_gone.is_set(),
                lambda: outputs[-1] if outputs else None,
            )  # fmt: skip
        except TisError as error:
            _print_json({"faults": [str(fault) for fault in error.faults]})
            return error.exit_code
        except Exception as error:
            _print_json({"faults": [f"bug: {type(error).__name__}: {error}"]})
            return EXIT_BUG
    return EXIT_OK


def _print_json(content: dict[str, object]) -> None:
    print(json.dumps(content), flush=True)  # noqa: T201  (standard output is what the parent reads)


if __name__ == "__main__":
    code = main(sys.argv[1])
    sys.stdout.flush()
    # Zenoh's threads may still be releasing callbacks, which aborts a regular end of the interpreter.
    os._exit(code)
