"""Warnings and faults on the terminal: one line each, never wrapped or read as markup."""

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
