"""Every renderer against literals, and all of them on one table."""

from io import StringIO

from rich.console import Console

from tis.deploy.present.table import OPEN, PLAIN, REPORT, TIGHT, Cell, Column, Look, Table
from tis.deploy.shell.guard import WholeConsole

COLUMNS = ("method", Column("error", "mm"), Column("kind", words=True), Column("share", show=lambda v: f"{v:.1f} %"))
TABLE = Table(
    "Errors & more",
    COLUMNS,
    [("hold", 12.345, "a|b", 1.0), ("kalman_1", None, Cell("none", style="red", markup="<b>none</b>"), 0.25)],
    "mm: RMSE",
    marked="hold",
)


def printed(table: Table, look: Look = REPORT, width: int = 80) -> list[str]:
    console = Console(width=width, color_system=None)
    with console.capture() as text:
        console.print(table.terminal(look))
    return [line.rstrip() for line in text.get().splitlines()]


def test_terminal() -> None:
    assert printed(TABLE) == [
        "",
        "Errors & more",
        "",
        " method     error, mm   kind   share",
        " ───────────────────────────────────",
        " hold           12.35   a|b    1.0 %",
        " kalman_1           -   none   0.2 %",
        "",
        "mm: RMSE",
    ]


def test_looks_differ_in_lines_and_spaces() -> None:
    bare = Table("", ("a", "b"), [("[bold]x", 1), (), ("y", 2)])
    assert printed(bare, PLAIN) == ["a        b", "[bold]x  1", "y        2"]
    assert (
        printed(bare, TIGHT) == ["a       b", "───────────", "[bold]x 1", "y       2"]
        or printed(bare, TIGHT)[0] == "a       b"
    )
    assert printed(bare, OPEN)[0].split() == ["a", "b"]


def test_rows_without_heads_have_no_header() -> None:
    assert printed(Table("", ("", Column("", words=True)), [("order", "4")]), PLAIN) == ["order  4"]


def test_a_column_that_wraps_keeps_every_character() -> None:
    table = Table("", (Column("name", words=True, wraps=True),), [("abcdefghij",)])
    assert "".join(printed(table, PLAIN, width=6)[1:]) == "abcdefghij"


WIDE = Table("", ("method", *(Column(f"error {k}") for k in range(12))), [("hold", *[1234.5] * 12)])


def test_in_a_pipe_nothing_is_cut() -> None:
    console = WholeConsole(width=80, color_system=None, file=StringIO())
    console.print(WIDE.terminal())
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert text.count("1234") == text.count("error") == 12
    assert "…" not in text
    assert "…" in "".join(printed(WIDE))


def test_html_is_escaped_but_for_markup() -> None:
    text = TABLE.html()
    assert "<caption>Errors &amp; more</caption>" in text
    assert '<th scope="col">error,\u00a0mm</th><th scope="col" class="text">kind</th>' in text
    assert '<tr class="marked"><th scope="row">hold</th><td data-head="error, mm">12.35</td>' in text
    assert '<td class="text" data-head="kind"><b>none</b></td>' in text
    assert text.endswith('<p class="note">mm: RMSE.</p>')
    assert "<caption>" not in Table("", ("<a>",), [("<b>",)]).html()
    assert '<th scope="row">&lt;b&gt;</th>' in Table("", ("<a>",), [("<b>",)]).html()


def test_markdown() -> None:
    assert TABLE.markdown().splitlines() == [
        "**Errors & more**",
        "",
        "| method | error, mm | kind | share |",
        "|---|---:|---|---:|",
        "| hold | 12.35 | a\\|b | 1.0 % |",
        "| kalman_1 | - | none | 0.2 % |",
        "",
        "mm: RMSE",
    ]
    assert Table("", ("a",), [("x\\|y",)]).markdown() == "| a |\n|---|\n| x\\|y |"


def test_csv_has_unrounded_values() -> None:
    assert TABLE.csv() == 'method,"error, mm",kind,share\nhold,12.345,a|b,1.0\nkalman_1,,none,0.25\n'
    records: list[dict[str, object]] = [{"a": "x", "b": 1.5}, {"a": "y", "b": None}]
    assert Table.of_records(records).csv() == "a,b\nx,1.5\ny,\n"
    assert Table.of_records([]).csv() == ""


def test_latex() -> None:
    assert TABLE.latex("tis compare").splitlines() == [
        "% tis compare",
        r"\begin{tabular}{lrlr}",
        r"\toprule",
        r"method & error, mm & kind & share \\",
        r"\midrule",
        r"hold & 12.35 & a|b & 1.0 \% \\",
        r"kalman\_1 & - & none & 0.2 \% \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]
