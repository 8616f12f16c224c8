"""Output of commands: data as JSON, warnings and faults as one line each, never wrapped or read as markup."""

import json
from typing import Any

from rich.console import Console
from rich.markup import escape


def print_warnings(err: Console, *texts: str) -> None:
    """Print a yellow line for each warning."""
    for text in texts:
        err.print(escape(f"warning: {text}"), style="yellow", soft_wrap=True)


def print_faults(err: Console, *texts: str) -> None:
    """Print a red line for each fault."""
    for text in texts:
        err.print(escape(f"tis: {text}"), style="red", soft_wrap=True)


def print_json(data: Any) -> None:
    """Print data to standard output, for other programs."""
    print(json.dumps(data, indent=1, allow_nan=False))  # noqa: T201
