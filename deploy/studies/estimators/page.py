"""Page ``docs/research/estimators.md``: a repeatable comparison, and the purpose of each estimator.

No figure is typed by hand: each comes from a request whose command is printed beside it.
"""

import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any, Final, Literal

import yaml
from rich.console import Console

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK
from tis.common.estimators import ESTIMATORS, NAMES
from tis.common.runtime.recordings import list_trials
from tis.common.runtime.recordings.jigsaws import JIGSAWS_VARIABLE
from tis.common.scenario.source import JigsawsSource
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.command import run
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.compare.grid import parse_sweep
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.compare.results import tables
from tis.deploy.compare.results.answer import answer
from tis.deploy.compare.results.pooled import ENOUGH_PEOPLE, interval_note
from tis.deploy.compare.results.report import report as build_report
from tis.deploy.present.numbers import per_axis
from tis.deploy.present.table import Column, Table
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs, print_faults
from tis.deploy.studies.paper.cells import ROWS
from tis.deploy.studies.tables import filled

_COMPARED: Final = tuple(NAMES)
"""Estimators of the tables; the methods of the paper have a page (`tis paper`)."""

Shows = Literal["errors", "redundancy", "paper", "ages", "orientation"]


@dataclass(frozen=True)
class Section:
    """Section of the page: request and explanation; ``shows`` selects the tables besides errors and cost."""

    title: str
    about: str
    request: Request
    shows: Shows


def sections() -> list[Section]:
    """Return the page's sections: on synthetic movement, and on recorded trials if available."""
    raw = yaml.safe_load((_HERE / "sections.yaml").read_text(encoding="utf-8"))
    found = []
    for name, source in raw["sources"].items():
        last: tuple[str, ...] | None = None
        if name != "synthetic":
            if not os.environ.get(JIGSAWS_VARIABLE):
                continue
            trials = list_trials(JigsawsSource(kind="jigsaws", task="Suturing"))
            last = tuple({trial[0]: trial for trial in trials}.values()) or None
        found += [_section(each, name, source, last) for each in raw["sections"] if each.get("of", name) == name]
    return found


def _section(raw: dict[str, Any], name: str, source: dict[str, Any], last: tuple[str, ...] | None) -> Section:
    request = Request(
        "default",
        (*source["set"], *raw["set"]),
        tuple(raw.get("estimators", _COMPARED)),
        None if raw.get("trials") == "all" else last,
        n_seeds=source.get("seeds"),
        duration_s=source.get("duration_s"),
        sweeps=(parse_sweep(raw["sweep"]),),
    )
    return Section(raw["title"].format(source=name), raw["about"], request, raw["shows"])


def shows_of(title: str) -> Shows:
    """Return what the section with a title shows besides errors and cost; errors alone where there is none now."""
    raw = yaml.safe_load((_HERE / "sections.yaml").read_text(encoding="utf-8"))
    titles = {
        section["title"].format(source=source): section["shows"]
        for section in raw["sections"]
        for source in raw["sources"]
    }
    shows: Shows = titles.get(title, "errors")
    return shows


def command_of(request: Request) -> str:
    """Return the command that repeats a request."""
    options: list[tuple[str, object]] = [
        ("--estimators", ",".join(request.estimators or ())),
        ("--trials", ",".join(request.trials or ())),
        ("--seeds", request.n_seeds),
        ("--duration-s", None if request.duration_s is None else f"{request.duration_s:g}"),
        *(("--sweep", f"{sweep.path}={','.join(sweep.values)}") for sweep in request.sweeps),
        *(("--set", setting) for setting in request.settings),
    ]
    words = [word for option, value in options if value for word in (option, str(value))]
    return shlex.join(["tis", "compare", request.scenario, *words])


Report = Mapping[str, Any]

_FEW_TICKS: Final = 30
_OURS: Final = "innovations_kf"
_HERE: Final = Path(__file__).parent


def write_page(page: Path, out_dir: Path | None, workers: Workers, out: Console, err: Console) -> int:
    """Compute all sections and write the page; failed cells are listed. Raises `DataError`."""
    check_outputs(page)
    found = []
    with workers:
        store = Store(out_dir or Path("runs") / "compare" / "page")
        for section in sections():
            plan = make_plan(section.request)
            err.print(section.title, style="dim")
            outcome = run(plan, store, workers, err)
            found.append((section, build_report(plan, outcome, command_of(section.request))))
    failed = [text for _, report in found for text in report["failed"]]
    print_faults(err, *failed)
    folder.write(page, page_text(found))
    n_cells = sum(report["n_computed"] for _, report in found)
    out.print(f"written to {page}: {len(found)} comparisons, {n_cells} twins", soft_wrap=True)
    return EXIT_INVALID_RUN if failed else EXIT_OK


def page_text(found: Sequence[tuple[Section, Report]]) -> str:
    """Return the page."""
    return filled(
        _HERE / "page.md",
        words="\n".join(f"- **`{name}`**: {ESTIMATORS[name].words}" for name in NAMES),
        few_people=_few_people(found),
        sections="\n\n".join(
            block
            for k, (section, report) in enumerate(found)
            for block in blocks_of(section, report, {one.about: one.title for one, _ in reversed(found[:k])})
        ),
    )


def blocks_of(section: Section, report: Report, told: Mapping[str, str]) -> Iterator[str]:
    """Yield the paragraphs and tables of a section; an explanation is told once."""
    why = section.about if section.about not in told else f"As in *{told[section.about]}*."
    yield f"## {section.title}\n\n{why}\n\n```\n{report['command']}\n```"
    if section.shows == "orientation":
        yield tables.headline(report)
        yield tables.turn_ratio_table(report).markdown()
        yield tables.turn_table(report["orientation"], settings=True).markdown()
        yield f"{tables.TURN_CAPTION}."
        return
    yield f"{tables.headline(report)} {answer(report)}".strip()
    about = [entry for entry in report["settings"] if entry["n_cells"]]
    if section.shows == "redundancy":
        yield _price(report, about)
    if section.shows == "ages":
        yield _by_age(report)
    if section.shows == "paper":
        yield _beside_the_paper(report, about)
    if section.shows in ("redundancy", "paper"):
        yield f"R\u00b2 in %, x y z:\n\n{_r2_table(report, about)}\n\nRMSE over hold's:"
    yield tables.ratio_table(report).markdown()
    yield f"Over the {len(about)} settings:\n\n{_details(report)}"


def _few_people(found: Sequence[tuple[Section, Report]]) -> str:
    """Return a note on sections with few people; empty without any."""
    rows = [row for _, report in found for row in report["rows"]]
    note, most = interval_note(rows), max((row["n_people"] for row in rows), default=0)
    of = "" if most < ENOUGH_PEOPLE else "Some tables are of fewer people than others. In these, this holds: "
    return f"\n- **Few people**: {of}{note}" if note else ""


def _price(report: Report, about: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        (
            str(entry["setting"]),
            *(entry["age_ms"][name] for name in ("mean", "p50", "p99")),
            entry["packets_per_s"],
            entry["bytes_per_s"] / 1000,
        )
        for entry in about
    ]
    table = Table("", (report["sweep"], Column("mean age", "ms"), "p50", "p99", "packets/s", "kB/s"), rows)
    return f"What it buys and what it costs:\n\n{table.markdown()}"


def _r2_table(report: Report, about: Sequence[Mapping[str, Any]]) -> str:
    known = {(row["estimator"], row["setting"]): per_axis(row["r2_pct"], 1) for row in report["rows"]}
    rows = [[name, *(known.get((name, entry["setting"])) for entry in about)] for name in _estimators(report)]
    return Table("", ("estimator", *(str(entry["setting"]) for entry in about)), rows).markdown()


def _by_age(report: Report) -> str:
    """Return the error over hold's by the age of the freshest sample, all settings together."""
    squares: dict[str, dict[float, float]] = {}
    ticks: dict[float, int] = {}
    for row in report["rows"]:
        for entry in row["rmse_by_age_mm"]:
            own = squares.setdefault(row["estimator"], {})
            own[entry["from_ms"]] = own.get(entry["from_ms"], 0.0) + entry["n"] * entry["rmse_3d_mm"] ** 2
            if row["estimator"] == "hold":
                ticks[entry["from_ms"]] = ticks.get(entry["from_ms"], 0) + entry["n"]
    hold = squares["hold"]
    ages = [age for age, n in ticks.items() if n >= _FEW_TICKS and hold[age] > 0]
    rows = [
        [name, *(f"{sqrt(own[age] / hold[age]):.3f}" for age in ages)]
        for name, own in squares.items()
        if name != "hold"
    ]
    rows.append(["ticks", *(str(ticks[age]) for age in ages)])
    table = Table("", ("estimator", *(f"from {age:g} ms" for age in ages)), rows)
    return f"RMSE over hold's by age, all settings together:\n\n{table.markdown()}"


def _beside_the_paper(report: Report, about: Sequence[Mapping[str, Any]]) -> str:
    """Return the paper's accuracy beside that of `innovations_kf`, pooled and in its worst trial."""
    known = {row["setting"]: row for row in report["rows"] if row["estimator"] == _OURS}
    cells, n_beaten, rows = 0, 0, []
    for entry in about:
        printed = next(row for row in ROWS if row.number == int(str(entry["setting"]).split("_")[1]))
        ours = known[entry["setting"]]["r2_pct"]
        beaten = [
            value is not None and value > paper for value, paper in zip(ours, printed.accuracy_pct, strict=True)
        ]
        cells, n_beaten = cells + len(beaten), n_beaten + sum(beaten)
        trials = [
            row["r2_pct"]
            for row in report["by_trial"]
            if row["estimator"] == _OURS and row["setting"] == entry["setting"]
        ]
        worst = [min(axis) for axis in zip(*trials, strict=True)] or [None]
        above = " ".join("yes" if better else "no" for better in beaten)
        rows.append((str(printed.number), *map(per_axis, (printed.accuracy_pct, ours, worst)), above))
    heads = ("row", "the paper, R\u00b2 in % x y z", f"`{_OURS}`", "its worst trial", "above the paper")
    return f"{n_beaten} of {cells} figures are above the paper's:\n\n{Table('', heads, rows).markdown()}"


def _details(report: Report) -> str:
    """Return cost and coverage of each estimator, over all settings of the section."""
    rows = []
    for name in _estimators(report):
        own = [row for row in report["rows"] if row["estimator"] == name]
        shares = [row["coverage_pct"] for row in own if row["coverage_pct"] is not None]
        each = [[row["step_us"][p] for row in own] for p in ("p50", "p99")]
        each.append([row["train_s"] for row in own if row["train_s"]])
        largest = (max((value for value in values if value is not None), default=None) for values in each)
        rows.append([name, f"{min(shares):.1f}-{max(shares):.1f}" if shares else "none", *largest])
    heads = ("estimator", "within the 95 % ellipsoid, %", "\u00b5s a step, p50", "p99", "training, s")
    return Table("", heads, rows).markdown()


def _estimators(report: Report) -> list[str]:
    return list(dict.fromkeys(row["estimator"] for row in report["rows"]))
