"""`tis scenarios` and `tis estimators`: what is shipped, each with a line."""

import re
from collections.abc import Mapping
from itertools import takewhile

from rich.console import Console

from tis.common.errors import EXIT_OK
from tis.common.estimators import ESTIMATORS, NAMES, OF_METHODS, OF_PAPER, scenario_name
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
        return EXIT_OK
    _show("scenario", lines, out)
    out.print("`tis validate NAME` prints one in full; `tis new NAME` writes one of your own", style="dim")
    return EXIT_OK


def list_estimators(out: Console, as_json: bool) -> int:
    """Print the estimators by the names that scenarios give them: each with what it is, and the studies' methods."""
    lines = {name: re.split("[;:]", _sentence(ESTIMATORS[name].words))[0] for name in NAMES}
    studied = {study: [name for name, row in ESTIMATORS.items() if row.judged_by == study]
               for study in (OF_PAPER, OF_METHODS)}  # fmt: skip
    if as_json:
        methods = {scenario_name(name): f"a method of `{study}`" for study, each in studied.items() for name in each}
        print_json(lines | methods)
        return EXIT_OK
    _show("estimator", lines, out)
    for study, each in studied.items():
        prefix = scenario_name(each[0]).removesuffix(each[0])
        out.print(f"methods of `{study}`, as {prefix}NAME: {', '.join(each)}")
    out.print("one of your own: module:factory; `tis compare SCENARIO --estimators A,B` compares", style="dim")
    return EXIT_OK


def _show(what: str, lines: Mapping[str, str], out: Console) -> None:
    columns: list[Column | str] = [what, Column("what it is", words=True, wraps=True)]
    out.print(Table("", columns, list(lines.items())).terminal(PLAIN))


def _sentence(text: str) -> str:
    return text.partition(". ")[0].removesuffix(".")


def _first_sentence(text: str) -> str:
    """Return the first sentence of the comment that begins a file."""
    comment = takewhile(lambda line: line.startswith("#"), text.splitlines())
    return _sentence(" ".join(line.lstrip("# ") for line in comment))
