"""`tis scenarios` and `tis estimators`: what is shipped, each with a line; `tis new`: a copy of it."""

import re
from collections.abc import Mapping
from itertools import takewhile
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.estimators import ESTIMATORS, NAMES, OF_METHODS, OF_PAPER, scenario_name
from tis.common.runtime.process import command_line
from tis.common.scenario import reading
from tis.deploy.present.table import PLAIN, Column, Table
from tis.deploy.shell.guard import print_json
from tis.deploy.shell.run_dir import write
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


# `tis new`: a commented scenario, and the schema by which editors check and complete it.

SCHEMA_FILE: Final = "scenario.schema.json"
_TEMPLATE: Final = Path(__file__).with_name("new_scenario.yaml")
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def write_new(name: str, out: Console) -> int:
    """Write ``NAME.yaml``, and its schema beside it; raises `InputError` for a bad name and a file that exists.

    ``name`` may have a folder and the suffix ``.yaml``. The schema is written again, for this version of tis.
    """
    path = Path(name)
    path = path if path.suffix in (".yaml", ".yml") else path.with_name(f"{path.name}.yaml")
    faults = []
    if _NAME.fullmatch(path.stem) is None:
        faults.append(
            Fault("tis new", "NAME", "must be letters, digits, - and _, and begin with none of these two", name)
        )
    if path.stem in shipped_names():
        faults.append(
            Fault("tis new", "NAME", f"must not be a shipped scenario's, which `tis run {name}` runs", name)
        )
    if path.exists():
        faults.append(Fault(str(path), "", "exists already and is not replaced"))
    if not path.parent.is_dir():
        faults.append(Fault(str(path.parent), "", "folder does not exist"))
    if faults:
        raise InputError(faults)
    write(path.with_name(SCHEMA_FILE), reading.schema_json() + "\n")
    write(path, _TEMPLATE.read_text(encoding="utf-8").replace("name: NAME", f"name: {path.stem}"))
    run = command_line(["run", str(path)])
    out.print(escape(f"{path} written, and {SCHEMA_FILE}, by which editors check it; run it: {run}"), soft_wrap=True)
    return EXIT_OK
