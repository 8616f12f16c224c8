"""`tis scenarios`: the shipped scenarios, each with a line."""

from itertools import takewhile

from rich.console import Console

from tis.common.errors import EXIT_OK
from tis.deploy.present.table import PLAIN, Column, Table
from tis.deploy.shell.guard import print_json
from tis.deploy.shell.shipped_scenarios import SHIPPED, shipped_names


def list_scenarios(out: Console, as_json: bool) -> int:
    """Print each shipped scenario with the first sentence of its file's comment."""
    lines = {
        name: _first_sentence((SHIPPED / f"{name}.yaml").read_text(encoding="utf-8")) for name in shipped_names()
    }
    if as_json:
        print_json(lines)
    else:
        columns: list[Column | str] = ["scenario", Column("what it is", words=True, wraps=True)]
        out.print(Table("", columns, list(lines.items())).terminal(PLAIN))
        out.print("`tis validate NAME` prints one in full; `tis new NAME` writes one of your own", style="dim")
    return EXIT_OK


def _first_sentence(text: str) -> str:
    """Return the first sentence of the comment that begins a file."""
    comment = takewhile(lambda line: line.startswith("#"), text.splitlines())
    return " ".join(line.lstrip("# ") for line in comment).partition(". ")[0].removesuffix(".")
