"""The tables of each study, computed again: by the study's own code, from the commands committed with them.

What is committed was computed on rows as they were recorded; so it is computed again, whatever the defaults are now.
"""

import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from tis.common.errors import DataError
from tis.common.estimators import ESTIMATORS, scenario_name, short_name
from tis.common.scenario.estimator_names import is_learned
from tis.deploy.bench.models import write_models_page
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.command import plan_of, run
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.compare.plan import Request
from tis.deploy.compare.results.report import report
from tis.deploy.studies.estimators.page import Section, blocks_of, shows_of
from tis.deploy.studies.methods.command import Options, write_methods
from tis.deploy.studies.paper.cells import Trial
from tis.deploy.studies.paper.command import write_paper
from tis.deploy.studies.tables import Table, committed, committed_folder, tables_in

_NAMED: Final = {
    "--estimators": "estimators",
    "--trials": "trials",
    "--seeds": "n_seeds",
    "--duration-s": "duration_s",
}
_NUMBERS: Final = {"n_seeds": int, "duration_s": float}
_RECORDED: Final = "recorded suturing"
_QUICK_METHODS: Final = "hold,arx_kf"


@dataclass(frozen=True)
class Job:
    """What is computed: where its twins are kept, how much of it, with how many workers."""

    place: Path
    quick: bool
    n_jobs: int | None
    workers: Workers
    out: Console
    err: Console


@dataclass(frozen=True)
class Study:
    """A study: its committed tables, how they are computed again, what it costs, and which cells time the machine."""

    tables: str
    recompute: Callable[[Job], list[Table]]
    cost: str
    is_machine: Callable[[Table, str, str], bool]


def _estimators(job: Job) -> list[Table]:
    """Compute the page's sections again, each by its command; ``quick``: the first setting of synthetic ones."""
    found: list[Table] = []
    store = Store(job.place / "twins")
    with job.workers:
        for heading, command in commands("estimators"):
            if job.quick and heading.endswith(_RECORDED):
                continue
            given = _given(command)
            if job.quick:
                path, _, values = given["sweeps"][0].partition("=")
                given["sweeps"] = [f"{path}={values.split(',')[0]}"]
            job.err.print(heading, style="dim")
            try:
                plan = plan_of(given)
            except DataError as error:  # no recordings
                job.err.print(f"left out: {error.faults[0]}", style="yellow", soft_wrap=True)
                continue
            outcome = run(plan, store, job.workers, job.err)
            outcome.check()
            section = Section(heading, "", Request(given["scenario"]), shows_of(heading))
            text = "\n\n".join(blocks_of(section, report(plan, outcome, ""), {}))
            tables = tables_in(text)
            found += (
                [table for table in tables if _is_of_settings(table, plan.points[0].label)] if job.quick else tables
            )
    return found


def _is_of_settings(table: Table, label: str | None) -> bool:
    """Tell whether a table has a column or a row for a setting: others are of all settings together."""
    return label in table["columns"][1:] or label in [row[0] for row in table["rows"]]


def commands(name: str) -> Iterator[tuple[str, str]]:
    """Yield heading and command of each section of a study."""
    text = (committed_folder() / f"{name}.sh").read_text(encoding="utf-8")
    yield from re.findall(r"^# (.+)\n(.+)$", text, re.MULTILINE)


def _given(command: str) -> dict[str, Any]:
    """Return the options of a committed `tis compare`, without estimators that are gone."""
    words = shlex.split(command)
    given: dict[str, Any] = {"scenario": words[2], "settings": [], "sweeps": [], "zipped": False, "study": None}
    given |= dict.fromkeys(("estimators", "trials", "people", "n_seeds", "seed", "duration_s"))
    for option, value in zip(words[3::2], words[4::2], strict=True):
        if option in ("--set", "--sweep"):
            given["settings" if option == "--set" else "sweeps"].append(value)
        else:
            name = _NAMED[option]
            given[name] = _NUMBERS.get(name, str)(value)
    there = [short_name(name) for name in given["estimators"].split(",")]
    given["estimators"] = ",".join(scenario_name(name) for name in there if name in ESTIMATORS)
    return given


def _paper(job: Job) -> list[Table]:
    page = job.place / "paper.md"
    write_paper(
        Trial(None, "Suturing", "D002", 7), page, job.place / "twins", job.quick, job.n_jobs, job.out, job.err
    )
    return tables_in(page.read_text(encoding="utf-8"))


def _methods(job: Job) -> list[Table]:
    """Compute methods again: with ``quick`` one beside hold, else those whose models are not learned."""
    page = job.place / "methods.md"
    known = [name for name in committed("methods")[0]["columns"] if name in ESTIMATORS]
    names = _QUICK_METHODS if job.quick else ",".join(name for name in known if not is_learned(name))
    options = Options(None, "Suturing", 7, names, page, job.place / "twins", False, job.n_jobs)
    write_methods(options, job.out, job.err)
    return tables_in(page.read_text(encoding="utf-8"))


def _network(job: Job) -> list[Table]:
    page = job.place / "draws.md"
    write_models_page(page, job.out)
    return tables_in(page.read_text(encoding="utf-8"))


def _is_time(table: Table, row: str, column: str) -> bool:
    """Tell whether a cell of the page on estimators is a time of this machine."""
    del row
    timed = any(name.startswith("µs") for name in table["columns"])
    return timed and (column.startswith(("µs", "training")) or column == "p99")


def _never(table: Table, row: str, column: str) -> bool:
    """Return False: no cell is a time."""
    del table, row, column
    return False


_TIMED_TABLES: Final = ("Training, s of processor time, by number of training trials", "Steps", "Exponents")
_TIMED_ROWS: Final = ("Computational Complexity", "Real-Time Performance", "Scalability", "Training Time")


def _is_methods_time(table: Table, row: str, column: str) -> bool:
    del column
    return table["heading"] in _TIMED_TABLES or row in _TIMED_ROWS


STUDIES: Final[dict[str, Study]] = {
    "estimators": Study("estimators", _estimators, "--quick: minutes; all of it, with recordings: hours", _is_time),
    "methods": Study("methods", _methods, "all recordings and methods: 20 minutes on two cores", _is_methods_time),
    "paper": Study("paper", _paper, "minutes, on one recording", _never),
    "network": Study("draws", _network, "7 s of a core, also with --quick", _never),
}
