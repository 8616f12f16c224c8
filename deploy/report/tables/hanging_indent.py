"""Terminal paragraph with a hanging indent."""

from dataclasses import dataclass
from typing import Final

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

_HANG: Final = 2


@dataclass(frozen=True)
class HangingIndent:
    """Text indented by ``indent`` columns, and two more after the first line. Oracle: test_hanging_indent."""

    text: str
    style: str = ""
    indent: int = 2

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the lines, wrapped to the console's width."""
        further = self.indent + _HANG
        lines = Text(self.text, style=self.style).wrap(console, max(1, options.max_width - further))
        for i, line in enumerate(lines):
            yield Text(" " * (further if i else self.indent)) + line
