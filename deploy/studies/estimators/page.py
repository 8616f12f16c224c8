"""Page ``docs/research/estimators.md``: a repeatable comparison, and the purpose of each estimator.

No figure is typed by hand: each comes from a request whose command is printed beside it.
"""

from collections.abc import Iterable, Sequence
from math import sqrt
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.command import run
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.compare.plan import make_plan
from tis.deploy.compare.results import tables
from tis.deploy.compare.results.pooled import ENOUGH_PEOPLE, interval_note
from tis.deploy.compare.results.report import report as build_report
from tis.deploy.compare.results.tables import TURN_CAPTION, TURN_HEAD, orientation_cells, orientation_ratios
from tis.deploy.present.numbers import number
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.early_checks import check_outputs
from tis.deploy.shell.guard import print_faults
from tis.deploy.studies.estimators.descriptions import DESCRIPTIONS
from tis.deploy.studies.estimators.sections import NAMES, Section, command_of, sections
from tis.deploy.studies.paper.printed import ROWS

_FEW_TICKS: Final = 30
_OURS: Final = "innovations_kf"


def write_page(page: Path, out_dir: Path | None, workers: Workers, out: Console, err: Console) -> int:
    """Compute all sections and write the page; failed cells are listed. Raises `DataError`."""
    check_outputs(page)
    reports = []
    with workers:
        store = Store(out_dir or Path("runs") / "compare" / "page")
        for section in sections():
            plan = make_plan(section.request)
            err.print(section.title, style="dim")
            reports.append(build_report(plan, run(plan, store, workers, err), command_of(section.request)))
    failed = [text for report in reports for text in report["failed"]]
    print_faults(err, *failed)
    folder.write(page, page_text(list(zip(sections(), reports, strict=True))))
    n_cells = sum(report["n_computed"] for report in reports)
    out.print(f"written to {page}: {len(reports)} comparisons, {n_cells} twins", soft_wrap=True)
    return EXIT_INVALID_RUN if failed else EXIT_OK


def page_text(found: Sequence[tuple[Section, dict[str, Any]]]) -> str:
    """Return the page."""
    blocks = [
        _HEADER,
        "\n".join(f"- **`{name}`**: {DESCRIPTIONS[name]}" for name in NAMES),
        _READING + _few_people(found),
    ]
    for section, report in found:
        blocks.append(f"## {section.title}\n\n{section.about}\n\n```\n{report['command']}\n```")
        best = "" if section.shows == "orientation" else _best(report)
        blocks.append(f"{tables.headline(report)} {best}".strip())
        about = [entry for entry in report["settings"] if entry["n_cells"]]
        if section.shows == "redundancy":
            blocks += [_price(report, about), _r2_table(report, about)]
        if section.shows == "ages":
            blocks.append(_by_age(report))
        if section.shows == "paper":
            blocks += [_beside_the_paper(report, about), _r2_table(report, about)]
        if section.shows == "orientation":
            blocks += [tables.markdown_table(*orientation_ratios(report)), _turns(report)]
            continue
        blocks += [tables.markdown_table(*tables.ratios(report)), _details(report, about)]
    return "\n\n".join(blocks) + "\n"


def _turns(report: dict[str, Any]) -> str:
    """Return the table of the orientation methods at each setting."""
    rows = [(str(row["setting"]), *orientation_cells(row)) for row in report["orientation"]]
    return f"{tables.markdown_table(('setting', *TURN_HEAD), rows)}\n\n{TURN_CAPTION}."


def _few_people(found: Sequence[tuple[Section, dict[str, Any]]]) -> str:
    """Return a note on sections with few people; empty without any."""
    rows = [row for _, report in found for row in report["rows"]]
    note, most = interval_note(rows), max((row["n_people"] for row in rows), default=0)
    of = "" if most < ENOUGH_PEOPLE else "Some tables are of fewer people than others. In these, this holds: "
    return f"\n- **Few people**: {of}{note}" if note else ""


def _best(report: dict[str, Any]) -> str:
    """Return the estimator with the smallest error at each setting."""
    winners: dict[str, list[str]] = {}
    for about in report["settings"]:
        rows = [row for row in report["rows"] if row["setting"] == about["setting"]]
        rows = [row for row in rows if row["ratio_to_hold"] is not None]
        if rows:
            best = min(rows, key=lambda row: float(row["ratio_to_hold"]))["estimator"]
            winners.setdefault(best, []).append(about["setting"])
    return " ".join(
        f"`{name}` has the smallest error at {', '.join(settings)}." for name, settings in winners.items()
    )


def _price(report: dict[str, Any], about: Sequence[dict[str, Any]]) -> str:
    head = (report["sweep"], "mean age, ms", "p50", "p99", "packets/s", "kB/s")
    rows = [
        (
            str(entry["setting"]),
            *(number(entry["age_ms"][name]) for name in ("mean", "p50", "p99")),
            number(entry["packets_per_s"]),
            number(entry["bytes_per_s"] / 1000),
        )
        for entry in about
    ]
    return f"What it buys and what it costs:\n\n{tables.markdown_table(head, rows)}"


def _r2_table(report: dict[str, Any], about: Sequence[dict[str, Any]]) -> str:
    known = {(row["estimator"], row["setting"]): row for row in report["rows"]}
    names = list(dict.fromkeys(row["estimator"] for row in report["rows"]))
    head = ("estimator", *(str(entry["setting"]) for entry in about))
    rows = [[name, *(_axes(known.get((name, entry["setting"]))) for entry in about)] for name in names]
    return f"R\u00b2 in %, x y z:\n\n{tables.markdown_table(head, rows)}\n\nRMSE over hold's:"


def _by_age(report: dict[str, Any]) -> str:
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
    head = ("estimator", *(f"from {age:g} ms" for age in ages))
    ticks_row = ["ticks", *(str(ticks[age]) for age in ages)]
    return f"RMSE over hold's by age, all settings together:\n\n{tables.markdown_table(head, [*rows, ticks_row])}"


def _beside_the_paper(report: dict[str, Any], about: Sequence[dict[str, Any]]) -> str:
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
        rows.append(
            (
                str(printed.number),
                _percents(printed.accuracy_pct),
                _percents(ours),
                _percents(worst),
                "".join("yes " if better else "no " for better in beaten).strip(),
            )
        )
    head = ("row", "the paper, R\u00b2 in % x y z", f"`{_OURS}`", "its worst trial", "above the paper")
    return f"{n_beaten} of {cells} figures are above the paper's:\n\n{tables.markdown_table(head, rows)}"


def _percents(values: Iterable[float | None]) -> str:
    return " ".join("-" if value is None else f"{value:.2f}" for value in values)


def _axes(row: dict[str, Any] | None) -> str:
    if row is None:
        return "-"
    return " ".join("-" if v is None else f"{v:.1f}" if abs(v) < 1e4 else f"{v:.0e}" for v in row["r2_pct"])


def _details(report: dict[str, Any], about: Sequence[dict[str, Any]]) -> str:
    """Return cost and coverage of each estimator, over all settings of the section."""
    names = list(dict.fromkeys(row["estimator"] for row in report["rows"]))
    rows = []
    for name in names:
        own = [row for row in report["rows"] if row["estimator"] == name]
        shares = [row["coverage_pct"] for row in own if row["coverage_pct"] is not None]
        rows.append(
            [
                name,
                "none" if not shares else f"{min(shares):.1f}-{max(shares):.1f}",
                *(_largest([row["step_us"][p] for row in own]) for p in ("p50", "p99")),
                _largest([row["train_s"] for row in own if row["train_s"]]),
            ]
        )
    head = ("estimator", "within the 95 % ellipsoid, %", "\u00b5s a step, p50", "p99", "training, s")
    return f"Over the {len(about)} settings:\n\n{tables.markdown_table(head, rows)}"


def _largest(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return number(max(known)) if known else "-"


_HEADER: Final = """# The estimators, compared

The patient's side must know where the arm is *now*, and has only samples that are late, out of order, or lost.
This page compares what the estimators make of the same arrivals, and shows what sending every sample several times
buys. `tis compare --page` writes it; the command above a table computes its figures. The movement is synthetic, so
anybody can repeat it; where `TIS_JIGSAWS` names recorded trials, the same is done on those: constant delay and
adaptation on all trials, all else on the last trial of each person, each estimated with models of the *other* people.
`paper` and `paper_as_printed` go by the paper's own identification; [paper.md](paper.md) computes the paper's tables
again.

## What each is good for"""

_READING: Final = """## How to read the tables

- **Ratio to hold**: the 3D error (root mean square) over that of `hold` on the same ticks. 1 is as good as no
  model, 0.5 is half the error. In brackets: the 95 % bootstrap interval over people, each with all trials, and all
  estimators resampled alike; of synthetic movement, each seed is a person.
- **R\u00b2**: share of the movement's variance that the estimate explains, each trial about its own mean; 100 % is
  perfect, 0 is as good as the mean position, less than 0 is worse than that.
- **Within the 95 % ellipsoid**: how often the truth lies where the estimator says that it is with 95 % certainty.
  95 is honest; far less is overconfident, which is dangerous for whoever acts on it. *none*: it gives no
  uncertainty.
- **\u00b5s a step**: processor time of one estimate on the machine that wrote this page, beside all else that it did;
  `tis bench estimators` measures an estimator alone. At 1 kHz there are 1000.
  Training is the processor time of the identification when only that estimator is wanted; the model from command to
  arm, which all need, is in each of these figures. It is done once, before the run.
- **Age**: how old the freshest sample is that has arrived by the tick, be it a command or a position of the arm. No
  estimator can change it; redundancy on the wire does (`surgeon.copies`, `surgeon.copy_spacing_ms`,
  `surgeon.history`)."""
