"""Page of the comparison: every figure is computed, only the paper's words are typed."""

import csv
import io
import json
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from typing import Any, Final, NamedTuple

from tis.common.errors import GET_REPORT
from tis.deploy.compare.results.tables import markdown_table, tabular
from tis.deploy.studies.methods.claims import FAMILY_TITLES, MEMBERS
from tis.deploy.studies.methods.tables import detail_tables, main_table
from tis.deploy.studies.methods.verdicts import verdicts
from tis.deploy.studies.paper.markdown import table as left_table

# Files of the comparison: figures of every method as JSON and CSV, the paper's table for LaTeX, and plots.

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


def files_of(report: Mapping[str, Any]) -> Files:
    """Return all forms of a report (see `tis.deploy.studies.methods.command.report_of`)."""
    files: dict[str, str | bytes] = {
        "methods.json": json.dumps(report, indent=1, allow_nan=False) + "\n",
        "methods.csv": csv_of(report),
        "methods.tex": tabular(*main_table(report["methods"]), f"% {report['command']}", n_text=4),
    }
    if find_spec("matplotlib") is None:
        return Files(files, (f"no figures without matplotlib: {GET_REPORT}",))
    from tis.deploy.report.publication.matplotlib_figures import rendered
    from tis.deploy.studies.methods.plots import FIGURES  # loads matplotlib

    for name, draw in FIGURES.items():
        figure = draw(report["methods"])
        files |= {f"{name}.{form}": rendered(figure, form) for form in _FORMATS}
    return Files(files, ())


def csv_of(report: Mapping[str, Any]) -> str:
    """Return all figures in long form: one row a number, with the setting that it was measured at."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEAD)
    for figures in report["methods"]:
        for measure, content in figures.items():
            entries = content if isinstance(content, list) else [content]
            for entry in entries:
                if isinstance(entry, Mapping):
                    at = " ".join(f"{name}={entry[name]}" for name in _PLACES if name in entry)
                    writer.writerows((figures["method"], measure, at, *each) for each in _numbers(entry))
                elif isinstance(entry, float):
                    writer.writerow((figures["method"], measure, "", measure, entry))
    return text.getvalue()


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


Report = Mapping[str, Any]


def page_text(report: Report, pictures: str | None = None) -> str:
    """Return the page of a report (see `tis.deploy.studies.methods.command.report_of`).

    ``pictures`` is the folder of the figures beside the page, None where they could not be drawn.
    """
    methods = report["methods"]
    blocks = [
        _HEADER.format(data=_data(report), command=report["command"], families=_families()),
        *_quick(report),
        *_gaps(report),
        "## The paper's table, measured",
        _READING.format(**report["settings"]),
        left_table(*main_table(methods)),
        "## The measures",
    ]
    for title, (head, rows) in detail_tables(methods).items():
        if rows:
            blocks += [f"### {title}", *([_NOTES[title]] if title in _NOTES else [])]
            if pictures is not None and title in _PICTURES:
                name, words = _PICTURES[title]
                blocks.append(f"![{words}]({pictures}/{name}.svg)")
            blocks.append(markdown_table(head, rows))
    blocks += ["## What the adjectives turn out to be", _RULE]
    blocks.append("\n".join(f"- **{title}**: {text}" for title, text in verdicts(methods).items()))
    return "\n\n".join(blocks) + "\n"


def _data(report: Report) -> str:
    """Return on which trials everything was measured."""
    found = report["trials"]
    kind = "a synthetic population, as no recordings were there" if found["synthetic"] else "JIGSAWS"
    people = f"{len(found['people'])} people ({', '.join(found['people'])})"
    elsewhere = " and ".join(f"{len(names)} of {task}" for task, names in found["elsewhere"].items())
    others = f", and {elsewhere}" if elsewhere else "; there are no trials of another task"
    return f"{kind}: {len(found['names'])} trials of {found['task']} by {people}{others}"


def _families() -> str:
    return "; ".join(
        f"*{FAMILY_TITLES[family]}*: {', '.join(f'`{name}`' for name in names)}" for family, names in MEMBERS.items()
    )


def _quick(report: Report) -> list[str]:
    if not report["quick"]:
        return []
    return ["This page was made with `--quick`: few people, short trials, few settings. Its figures are rough."]


def _gaps(report: Report) -> list[str]:
    """Return what is missing, by method; nothing where everything is there."""
    found = [f"- `{each['method']}`: {'; '.join(each['gaps'])}" for each in report["methods"] if each["gaps"]]
    absent = [f"`{name}`" for name in report["absent"]]
    lines = [*found, *([f"- not among the methods: {', '.join(absent)}"] if absent else [])]
    return ["**What is missing.**\n\n" + "\n".join(lines)] if lines else []


_HEADER: Final = """\
# The paper's comparison of methods, measured

The paper compares its filter with Transformers, Gaussian processes and matrix factorisation in a table of
adjectives. Here each adjective is a figure: every method estimates on the same arrivals, with models of other
people. Measured on {data}. The page is written by

```
{command}
```

The paper's families are {families}. The other methods are the testbed's linear estimators, and `hold`, which
repeats the newest position that arrived."""

_READING: Final = """\
The first columns are the paper's words. Each cell is about models of all training trials, at a constant delay of
{delay_ms:g} ms where nothing else is said; the tables below have all settings and the intervals.

- *Computational complexity*: exponents of the time of training and of a step against training rows and block rows.
- *Real-time performance*: wall-clock time of a step for one hand, all methods in interleaved rounds in one
  process, and the highest rate of ticks at which these steps, one after the other, miss no tick: a tick is missed
  if its step has not begun when the next one is due. Nothing else takes time in that figure.
- *Handling packet loss*: the error at the greatest loss, in bursts of {mean_burst:g} messages on average, over
  that without loss, and over hold's at the same loss.
- *Adaptability*: the largest error after training on two trials of another person, or of another task, over that
  after training on two other trials of the same person.
- *Data requirements*: the number of training trials whose error is within 5 % of that with all of them.
- *Scalability*: the rate that both hands together allow, and the exponent of a step's time against block rows; in
  the table of steps also a synthetic hand at 1 kHz.
- *Robustness to noise*: as loss, with the greatest sensor noise on what is sent, and models that were trained
  without noise; then with models that were trained on rows with the same noise.
- *Training time*: processor time of one training on all other people's trials, all models that the method needs.
- *Reliability*: on a network that delays by 50 to 150 ms and loses 5 % in bursts.
- *Real-world applications*: error over hold's on people left out of the training, by delay: {delays} ms."""

_RULE: Final = """\
These sentences are chosen by rules from the figures above. Of each row one figure is compared (named in its last
sentence); less is better. A method is better than another if its figure is smaller by more than 5 % (an exponent:
by more than 0.05) and their 95 % intervals over people, where both have one, do not overlap. *Hardly* is a growth
of at most 10 %, *somewhat* of at most half, *much* up to three times. The smallest of all is sought among the
methods that err less than hold."""

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
