"""Process of the live page: ``python -m tis.deploy.view``, child of ``tis run --view`` or ``tis view``.

The first line of its standard input is its options as JSON, a later one may name the run's output. It prints one line
of JSON with the page's address or with faults. The process ends when that input is closed, which happens however its
parent ends.
"""

import json
import os
import sys
import threading
from collections.abc import Iterator
from typing import Final

from tis.common.errors import EXIT_BUG, EXIT_OK, TisError
from tis.common.runtime.process import Interrupt
from tis.deploy.view.page_text import RunOutput
from tis.deploy.view.server import ViewOptions, serve

_NICENESS: Final = 10
_READ_BYTES: Final = 1 << 16


def main() -> int:
    """Serve the page; return the exit code."""
    lines = _lines_of_parent()
    first = next(lines, None)
    if first is None:  # the parent has ended
        return EXIT_OK
    content = json.loads(first)
    options = ViewOptions(**{**content, "hosts": tuple(content["hosts"]), "cfg": tuple(content.get("cfg", ()))})
    os.nice(_NICENESS)  # the run itself has priority
    interrupt = Interrupt()
    parent_gone = threading.Event()

    outputs: list[RunOutput] = []

    def read_parent() -> None:
        try:
            for line in lines:
                outputs.append(RunOutput(**json.loads(line)))  # noqa: PERF401  (each as soon as it comes)
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


def _lines_of_parent() -> Iterator[bytes]:
    """Yield the lines of standard input, unbuffered: a buffer's lock would block the exit."""
    partial = b""
    while some := os.read(sys.stdin.fileno(), _READ_BYTES):
        *lines, partial = (partial + some).split(b"\n")
        yield from lines


def _print_json(content: dict[str, object]) -> None:
    print(json.dumps(content), flush=True)  # noqa: T201  (standard output is what the parent reads)


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    # Zenoh's threads may still be releasing callbacks, which aborts a regular end of the interpreter.
    os._exit(code)
