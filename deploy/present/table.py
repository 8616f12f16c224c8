"""A table of results, declared once and rendered for a terminal, a page, Markdown, CSV and LaTeX."""

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

from tis.deploy.present.numbers import NONE, shown

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.table import Table as RichTable

_WIDEST: Final = 10_000

Row = Sequence[Any]
"""Texts, numbers and None for what does not exist; a row without cells is a rule across a terminal's table."""

_SHORT: Final = re.compile(r", (?=\S{1,3}$)")
_PIPE: Final = re.compile(r"(?<!\\)\|")
_LATEX: Final = str.maketrans(
    {char: f"\\{char}" for char in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
    | {"\u00d7": r"$\times$", "\u00b5": r"$\mu$", "\u00b2": r"$^2$"}
)


class Look(NamedTuple):
    """The lines and spaces of a table in a terminal, by the words of `rich`."""

    box: str | None
    edge: bool = True
    pad_edge: bool = True
    padding: int | tuple[int, int, int, int] = (0, 1, 0, 1)
    spaced: bool = False
    """Whether an empty line stands above the title."""


REPORT: Final = Look("SIMPLE_HEAD", pad_edge=False, spaced=True)
"""The look of every table, 80 columns wide at most."""
OPEN: Final = REPORT._replace(edge=False, padding=(0, 1, 0, 0))
"""The same between words that belong to it."""
TIGHT: Final = OPEN._replace(padding=0)
"""The same with many columns."""
PLAIN: Final = Look(None, padding=(0, 2, 0, 0))
"""A list in columns, without lines."""


class Cell(str):
    """A text with a style in a terminal, or with safe markup on a page; elsewhere it is its text."""

    style: str
    markup: str

    def __new__(cls, text: str, style: str = "", markup: str = "") -> Self:
        """Return the text with its looks."""
        self = super().__new__(cls, text)
        self.style, self.markup = style, markup
        return self


@dataclass(frozen=True)
class Column:
    """A column: its head and unit, whether it holds words, and how its values are shown, texts and None apart.

    Words stand to the left and may wrap on a page; ``wraps`` lets a column wrap in a terminal, too. A terminal, with
    its 80 columns, shows ``short`` for the title if there is one, and leaves out what is ``on_page_only``.
    """

    head: str
    unit: str = ""
    words: bool = False
    wraps: bool = False
    show: Callable[[Any], str] = shown
    short: str = ""
    on_page_only: bool = False

    @property
    def title(self) -> str:
        """Return the head with its unit."""
        return f"{self.head}, {self.unit}" if self.unit else self.head


@dataclass(frozen=True)
class Table:
    """A title, columns and rows of values, with a note below. Oracle: literals, test_table.

    A column is given by its head alone where it holds numbers, or is the first: that one holds the rows' headings.
    The row with heading ``marked`` is highlighted on a page.
    """

    title: str
    columns: Sequence[Column | str]
    rows: Sequence[Row]
    note: str = ""
    marked: str | None = None

    @classmethod
    def of_records(cls, records: Sequence[Mapping[str, Any]], title: str = "") -> Self:
        """Return a table of mappings with the same keys, a column for each; without records it has none."""
        return cls(title, tuple(records[0]) if records else (), [tuple(record.values()) for record in records])

    def full_columns(self) -> list[Column]:
        """Return the columns with all that is known of them."""
        return [
            column if isinstance(column, Column) else Column(column, words=i == 0)
            for i, column in enumerate(self.columns)
        ]

    def texts(self) -> Iterator[list[str]]:
        """Yield the cells of each row as text, without rules."""
        columns = self.full_columns()
        for row in self.rows:
            if row:
                yield [_text(column, value) for column, value in zip(columns, row, strict=True)]

    def terminal(self, look: Look = REPORT) -> "RenderableType":
        """Return the table for `rich`, the note below it as wide as the console.

        A console that cuts nothing (`tis.deploy.shell.guard.WholeConsole`) gets it as wide as its cells need.
        """
        from rich import box, table
        from rich.console import Group
        from rich.markup import escape as escaped
        from rich.text import Text

        columns = [column for column in self.full_columns() if not column.on_page_only]
        view = table.Table(
            title=("\n" * look.spaced + escaped(self.title)) if self.title else None,
            title_justify="left",
            box=getattr(box, look.box) if look.box else None,
            show_edge=look.edge,
            pad_edge=look.pad_edge,
            padding=look.padding,
            show_header=any(column.head for column in columns),
        )
        for column in columns:
            how: dict[str, Any] = {"overflow": "fold"} if column.wraps else {"no_wrap": True}
            view.add_column(Text(column.short or column.title), justify="left" if column.words else "right", **how)
        for row in self.rows:
            each = zip(self.full_columns(), row, strict=True) if row else ()
            cells = [_text(column, value) for column, value in each if not column.on_page_only]
            view.add_row(*(Text(cell, getattr(cell, "style", "")) for cell in cells)) if row else view.add_section()
        whole = _whole(view)
        return Group(whole, Text(self.note, style="table.caption")) if self.note else whole

    def html(self) -> str:
        """Return the table for a page, escaped but for the markup of its cells, with the note as a paragraph.

        Each cell knows the head of its column, which a narrow page shows beside it when it stacks the cells of a row.
        """
        first, *others = self.full_columns()
        heads = [first.title, *(column.title for column in others)]
        looks = ["", *(' class="text"' if column.words else "" for column in others)]
        columns = "".join(
            f'<th scope="col"{look}>{_markup(_bound(head))}</th>' for head, look in zip(heads, looks, strict=True)
        )
        body = []
        for heading, *cells in self.texts():
            chosen = ' class="marked"' if heading == self.marked else ""
            values = "".join(
                f'<td{look} data-head="{escape(head)}">{_markup(cell)}</td>'
                for cell, look, head in zip(cells, looks[1:], heads[1:], strict=True)
            )
            body.append(f'<tr{chosen}><th scope="row">{_markup(heading)}</th>{values}</tr>')
        caption = f"<caption>{escape(self.title)}</caption>" if self.title else ""
        words = escape(self.note.removesuffix("."), quote=False)
        note = f'<p class="note">{words}.</p>' if words else ""
        return (
            f'<div class="wide" role="region" tabindex="0" aria-label="{escape(self.title)}"><table>{caption}'
            f"<thead><tr>{columns}</tr></thead><tbody>{''.join(body)}</tbody></table></div>{note}"
        )

    def markdown(self) -> str:
        """Return the table in Markdown, below its title and above its note if it has them; no newline at the end."""
        columns = self.full_columns()
        lines = ["|" + "".join("---|" if column.words else "---:|" for column in columns)]
        lines = [_piped([column.title for column in columns]), *lines, *map(_piped, self.texts())]
        title, note = f"**{self.title}**" if self.title else "", self.note
        return "\n\n".join(part for part in (title, "\n".join(lines), note) if part)

    def csv(self) -> str:
        """Return head and values, unrounded, an empty field for None; empty without columns."""
        if not self.columns:
            return ""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column.title for column in self.full_columns()])
        writer.writerows(row for row in self.rows if row)
        return text.getvalue()

    def latex(self, *comments: str) -> str:
        """Return a ``tabular`` in the style of `booktabs`, comments above it."""
        columns = self.full_columns()
        return "\n".join(
            [
                *(f"% {comment}" for comment in comments),
                rf"\begin{{tabular}}{{{''.join('l' if column.words else 'r' for column in columns)}}}",
                r"\toprule",
                _latex_line(column.title for column in columns),
                r"\midrule",
                *map(_latex_line, self.texts()),
                r"\bottomrule",
                "\\end{tabular}\n",
            ]
        )


def _whole(view: "RichTable") -> "RenderableType":
    """Return a table that is wider than a console which cuts nothing, where its cells are."""
    from rich.measure import Measurement
    from rich.text import Text

    class Whole:
        def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
            if getattr(console, "cuts_nothing", False) and not console.is_terminal:
                for column in view.columns:
                    if column.no_wrap:
                        column.min_width = max(Text(str(cell)).cell_len for cell in (column.header, *column.cells))
                least = Measurement.get(console, options.update(max_width=_WIDEST), view).minimum
                options = options.update(width=max(least, options.max_width))
            yield from console.render(view, options)

        def __rich_measure__(self, console: "Console", options: "ConsoleOptions") -> Measurement:
            return Measurement.get(console, options, view)

    return Whole()


def _text(column: Column, value: Any) -> str:
    if value is None:
        return NONE
    return value if isinstance(value, str) else column.show(value)


def _markup(text: str) -> str:
    return getattr(text, "markup", "") or escape(text)


def _bound(head: str) -> str:
    """Return a column's head with its unit on the line of the word before it."""
    return _SHORT.sub(",\u00a0", head)


def _piped(cells: Iterable[str]) -> str:
    return "| " + " | ".join(_PIPE.sub(r"\\|", cell) for cell in cells) + " |"


def _latex_line(cells: Iterable[str]) -> str:
    return " & ".join(cell.translate(_LATEX) for cell in cells) + r" \\"
