"""Page of the comparison and its tables: every figure is computed, only the paper's words are typed."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

from tis.common.extras import GET_REPORT
from tis.deploy.present.numbers import NONE, per_axis, with_interval
from tis.deploy.present.table import Column, Table
from tis.deploy.studies.methods.claims import CLAIMS, FAMILY_TITLES, MEMBERS, verdicts
from tis.deploy.studies.methods.measured import Figures, exponent_text, loss_head, rate_text
from tis.deploy.studies.tables import filled


def main_table(methods: Sequence[Figures]) -> Table:
    """Return the paper's table: its features, its words on three families, and a measured cell of each method."""
    said = [Column(f"paper: {title}", words=True) for title in FAMILY_TITLES.values()]
    rows = [[claim.title, *claim.words.values(), *map(claim.cell, methods)] for claim in CLAIMS.values()]
    return Table("", ["feature", *said, *(str(figures["method"]) for figures in methods)], rows)


def detail_tables(methods: Sequence[Figures]) -> dict[str, Table]:
    """Return a table of each measure by its title; those that nothing was measured for have no rows."""

    def by(measure: str, head: Callable[[Figures], str], cell: Callable[[Figures], str | float | None]) -> Table:
        """Return the table of one measure: a row for each method, a column for each of its settings."""
        heads = list(dict.fromkeys(head(entry) for figures in methods for entry in figures[measure]))
        found = {str(figures["method"]): {head(e): cell(e) for e in figures[measure]} for figures in methods}
        rows = [[name, *(cells.get(each) for each in heads)] for name, cells in found.items() if cells]
        return Table("", ["method", *heads], rows)

    return {
        "Ratio to hold by delay": by("accuracy", lambda e: f"{e['delay_ms']:g} ms", _ratio),
        "Ratio to hold by loss": by("loss", loss_head, _ratio),
        "Error by loss, over the method's own without loss": by("loss", loss_head, _growth),
        "R² in %, x y z, by loss": by("loss", loss_head, _r2),
        "Ratio to hold by noise": by("noise", _noise_head, _ratio),
        "Error by noise, over the method's own without noise": by("noise", _noise_head, _growth),
        "Ratio to hold by noise, trained with the same noise": by("noise_trained", _noise_head, _ratio),
        "R² in %, x y z, by noise": by("noise", _noise_head, _r2),
        "Ratio to hold by number of training trials": by("data", lambda e: str(e["n_trials"]), _ratio),
        "Training, s of processor time, by number of training trials": by(
            "data", lambda e: str(e["n_trials"]), lambda e: e["train_s"]
        ),
        "Error after training on others, over that after training on the own person": by(
            "adaptability", lambda e: str(e["trained_on"]), lambda e: with_interval(e["ratio"], _bounds(e))
        ),
        "Reliability": _reliability(methods),
        "Steps": _steps(methods),
        "Exponents": _exponents(methods),
        "Ratio to hold by block rows": by("size", lambda e: str(e["block_rows"]), _ratio),
    }


def _reliability(methods: Sequence[Figures]) -> Table:
    names = {"p50": "p50", "p95": "p95", "p99": "p99", "p100": "largest"}
    shares = (Column("missing", "%"), Column("in 95 % regions", "%"))
    rows = [
        [
            str(figures["method"]),
            _ratio(entry),
            *(entry[f"error_{name}_mm"] for name in names),
            entry["missing_pct"],
            entry["coverage_pct"],
        ]
        for figures in methods
        if (entry := figures["reliability"]) is not None
    ]
    return Table("", ["method", "ratio to hold", *(Column(name, "mm") for name in names.values()), *shares], rows)


def _steps(methods: Sequence[Figures]) -> Table:
    p99, rate = Column("p99", "µs"), Column("highest rate, one hand", show=rate_text)
    times = (Column("p50", "µs"), p99, rate, Column("both hands", show=rate_text))
    at_1_khz = (Column("at 1 kHz: p50", "µs"), p99, "ratio to hold")
    rows = []
    for figures in methods:
        step, fast = figures["step"], figures["fast"]
        if step is not None:
            of_fast = [None] * 3 if fast is None else [fast["step_p50_us"], fast["step_p99_us"], _ratio(fast)]
            measured = [step[name] for name in ("p50_us", "p99_us", "rate_hz", "rate_both_hz")]
            rows.append([str(figures["method"]), *measured, *of_fast, figures["training_s"]])
    return Table("", ["method", *times, *at_1_khz, Column("training", "s")], rows)


def _exponents(methods: Sequence[Figures]) -> Table:
    names = {
        "train_rows": "training by rows",
        "step_rows": "step by rows",
        "train_size": "training by block rows",
        "step_size": "step by block rows",
    }
    laws = {str(figures["method"]): [figures["exponents"][name] for name in names] for figures in methods}
    rows = [[method, *each] for method, each in laws.items() if any(law is not None for law in each)]
    return Table("", ["method", *(Column(head, show=exponent_text) for head in names.values())], rows)


def _noise_head(entry: Figures) -> str:
    return f"{entry['noise_mm']:g} mm"


def _bounds(entry: Figures) -> tuple[float | None, float | None]:
    return entry["low"], entry["high"]


def _ratio(entry: Figures) -> str:
    return with_interval(entry["ratio_to_hold"], _bounds(entry))


def _growth(entry: Figures) -> str:
    growth = entry["growth"]
    return NONE if growth is None else with_interval(growth["ratio"], _bounds(growth))


def _r2(entry: Figures) -> str:
    return per_axis(entry["r2_pct"], 1)


Report = Mapping[str, Any]

_FORMATS: Final = ("svg", "pdf")
PLOTS: Final = ("accuracy", "disturbances", "training", "steps")
NAMES: Final = ("methods.json", "methods.csv", "methods.tex", *(f"{n}.{form}" for n in PLOTS for form in _FORMATS))
_HEAD: Final = ("method", "measure", "at", "figure", "value")
_PLACES: Final = ("delay_ms", "loss_pct", "bursts", "noise_mm", "n_trials", "trained_on", "block_rows")
"""Figures that say at which setting the others of an entry were measured."""


class Files(NamedTuple):
    """Contents by name, and what could not be made, with the command that helps."""

    contents: Mapping[str, str | bytes]
    left_out: tuple[str, ...]


def files_of(report: Report) -> Files:
    """Return all forms of a report (see `tis.deploy.studies.methods.command.report_of`)."""
    files: dict[str, str | bytes] = {
        "methods.json": json.dumps(report, indent=1, allow_nan=False) + "\n",
        "methods.csv": csv_of(report),
        "methods.tex": main_table(report["methods"]).latex(report["command"]),
    }
    if find_spec("matplotlib") is None:
        return Files(files, (f"no figures without matplotlib: {GET_REPORT}",))
    from tis.deploy.report.publication.matplotlib_figures import rendered
    from tis.deploy.studies.methods.plots import FIGURES  # loads matplotlib

    for name, draw in FIGURES.items():
        figure = draw(report["methods"])
        files |= {f"{name}.{form}": rendered(figure, form) for form in _FORMATS}
    return Files(files, ())


def csv_of(report: Report) -> str:
    """Return all figures in long form: one row a number, with the setting that it was measured at."""
    rows: list[tuple[Any, ...]] = []
    for figures in report["methods"]:
        for measure, content in figures.items():
            for entry in content if isinstance(content, list) else [content]:
                if isinstance(entry, Mapping):
                    at = " ".join(f"{name}={entry[name]}" for name in _PLACES if name in entry)
                    rows += [(figures["method"], measure, at, *each) for each in _numbers(entry)]
                elif isinstance(entry, float):
                    rows.append((figures["method"], measure, "", measure, entry))
    return Table("", _HEAD, rows).csv()


def _numbers(entry: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yield the numbers of an entry by name, those of its parts after theirs."""
    for name, value in entry.items():
        if prefix == "" and name in _PLACES:
            continue
        if isinstance(value, Mapping):
            yield from _numbers(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            yield from ((f"{prefix}{name}.{i}", each) for i, each in enumerate(value) if each is not None)
        elif isinstance(value, int | float):
            yield f"{prefix}{name}", value


def page_text(report: Report, pictures: str | None = None) -> str:
    """Return the page of a report (see `tis.deploy.studies.methods.command.report_of`).

    ``pictures`` is the folder of the figures beside the page, None where they could not be drawn.
    """
    methods = report["methods"]
    blocks = []
    for title, table in detail_tables(methods).items():
        if table.rows:
            blocks += [f"### {title}", *([_NOTES[title]] if title in _NOTES else [])]
            if pictures is not None and title in _PICTURES:
                name, words = _PICTURES[title]
                blocks.append(f"![{words}]({pictures}/{name}.svg)")
            blocks.append(table.markdown())
    return filled(
        Path(__file__).with_name("page.md"),
        data=_data(report),
        command=report["command"],
        families="; ".join(
            f"*{FAMILY_TITLES[family]}*: {', '.join(f'`{name}`' for name in names)}"
            for family, names in MEMBERS.items()
        ),
        quick=_QUICK if report["quick"] else "",
        gaps=_gaps(report),
        **report["settings"],
        table=main_table(methods).markdown(),
        measures="\n\n".join(blocks),
        verdicts="\n".join(f"- **{title}**: {text}" for title, text in verdicts(methods).items()),
    )


def _data(report: Report) -> str:
    """Return on which trials everything was measured."""
    found = report["trials"]
    kind = "a synthetic population, as no recordings were there" if found["synthetic"] else "JIGSAWS"
    people = f"{len(found['people'])} people ({', '.join(found['people'])})"
    elsewhere = " and ".join(f"{len(names)} of {task}" for task, names in found["elsewhere"].items())
    others = f", and {elsewhere}" if elsewhere else "; there are no trials of another task"
    return f"{kind}: {len(found['names'])} trials of {found['task']} by {people}{others}"


def _gaps(report: Report) -> str:
    """Return what is missing, by method; empty where everything is there."""
    lines = [f"- `{each['method']}`: {'; '.join(each['gaps'])}" for each in report["methods"] if each["gaps"]]
    if report["absent"]:
        lines.append(f"- not among the methods: {', '.join(f'`{name}`' for name in report['absent'])}")
    return "**What is missing.**\n\n" + "\n".join(lines) if lines else ""


_QUICK: Final = "This page was made with `--quick`: few people, short trials, few settings. Its figures are rough."
_PICTURES: Final = {
    "Ratio to hold by delay": ("accuracy", "Ratio to hold against the delay, a line for each method"),
    "Ratio to hold by loss": ("disturbances", "Ratio to hold against loss and noise, a line for each method"),
    "Ratio to hold by number of training trials": ("training", "Error and training time against training rows"),
    "Steps": ("steps", "Error against the time of a step"),
}
"""Figure above a table, and what it shows."""
_NOTES: Final = {
    "Ratio to hold by delay": (
        "RMSE in 3D over that of `hold` on the same ticks, in brackets the 95 % bootstrap interval over people. "
        "Methods whose training begins with random numbers are pooled over several seeds."
    ),
    "Steps": (
        "Medians over interleaved rounds on one machine: compare methods, not machines. At 1 kHz: processor time of "
        "the steps of a synthetic hand, with a model of its first 6 s, of learned methods 20 s."
    ),
    "Exponents": (
        "Slope of the logarithms, in brackets its 95 % confidence interval. An exponent near 0 means a cost that "
        "does not depend on it; the arm's model, which all need, is part of every training."
    ),
    "Reliability": (
        "A missing estimate counts with hold's error. *In 95 % regions*: the share of ticks at which the truth lies "
        "where the method says that it is with 95 % certainty."
    ),
    "Ratio to hold by block rows": (
        "One trial; models of four trials. The order of the arm's model is the number of block rows; other models "
        "choose theirs up to it."
    ),
}
