"""A paragraph of a list in a terminal: indented, and its further lines more so."""

from dataclasses import dataclass
from typing import Final

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

_MORE: Final = 2


@dataclass(frozen=True)
class HangingIndent:
    """Text that begins ``indent`` columns in and goes on two more in, at any width. Oracle: test_hanging_indent."""

    text: str
    style: str = ""
    indent: int = 2

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield a line of text for each that the console is wide enough for."""
        further = self.indent + _MORE
        lines = Text(self.text, style=self.style).wrap(console, max(1, options.max_width - further))
        for i, line in enumerate(lines):
            yield Text(" " * (further if i else self.indent)) + line
