"""``compare.html``: several runs side by side on one self-contained page."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from tis.deploy.report.compared.compared_figures import figures_table
from tis.deploy.report.compared.compared_plots import against_age, distributions, over_time
from tis.deploy.report.compared.scenario_differences import Differences, scenario_differences
from tis.deploy.report.measures.network.disturbances import Disturbance, disturbances, disturbances_text
from tis.deploy.report.page.html_page import Page, Section, page_html
from tis.deploy.report.plots.hand_view import HandView
from tis.deploy.report.run_view import RunView
from tis.deploy.report.tables.html_tables import markup_table, table
from tis.deploy.report.tables.numbers import number

_NUMBERS: Final = ("seed", "duration, s")


def compared_html(runs: Mapping[str, RunView]) -> str:
    """Return the page of two or more runs by name; the first is the baseline."""
    views = {name: _view(run) for name, run in runs.items()}
    names, listed = list(runs), list(runs.values())
    differences = scenario_differences([run.scenario for run in listed], [run.summary["mode"] for run in listed])
    found = {name: disturbances(run.logs, run.scenario) for name, run in runs.items()}
    synthetic = any(run.synthetic for run in listed)
    tags = [(f"{len(runs)} runs", "")]
    if synthetic:
        tags.append(("synthetic movement, not a recording of a person", "open"))
    if differences.fields and list(differences.fields) != ["seed"]:
        tags.append(("different scenarios", "open"))
    changed = [name for name, each in found.items() if any(one.live for one in each)]
    tags += [(f"{name}: network changed while running", "open") for name in changed]
    tags += [(f"{name}: not a valid measurement", "bad") for name, run in runs.items() if not run.summary["valid"]]
    sections = [
        Section("answer", "The answer", markup=_answer(runs, differences, found) + figures_table(names, listed)),
        Section("distributions", "Distributions", [*distributions(runs, views), against_age(views)], beside=True),
        Section("error", "Error", [over_time(views, found)]),
        Section("scenarios", "What differs in the scenarios", markup=_differences(names, differences)),
        Section("runs", "The runs", markup=_runs(runs)),
    ]
    return page_html(Page("Runs compared", "Runs compared", tags, sections))


def _answer(runs: Mapping[str, RunView], differences: Differences, found: Mapping[str, Sequence[Disturbance]]) -> str:
    """Return outages and live changes, the differences of the scenarios, and the runs with the least figures."""
    valid = {name: run for name, run in runs.items() if run.summary["valid"]}
    latencies = {name: run.summary["latency_ms"]["end_to_end"]["p50"] for name, run in valid.items()}
    errors = {
        n: r.summary["accuracy"].get(r.scenario.active_estimator, {}).get("rmse_3d_mm") for n, r in valid.items()
    }
    parts = [disturbances_text(name, each) for name, each in found.items()]
    parts.append(differences.statement(any(one.live for each in found.values() for one in each)))
    if len(valid) < len(runs):
        parts.append(f"No valid measurement, so not ranked: {', '.join(sorted(runs.keys() - valid.keys()))}.")
    if len({run.summary["mode"] for run in valid.values()}) == 1:  # virtual time has no computing time
        parts.append(_least("Least median end-to-end latency:", latencies, "ms"))
    if differences.same_movement:
        parts.append(_least("Least error (RMSE in 3D of the active estimator):", errors, "mm"))
    return f'<p class="answer">{escape(" ".join(filter(None, parts)))}</p>'


def _least(words: str, values: Mapping[str, float | None], unit: str) -> str:
    """Return the runs with the least value, and the values of the others; "" when all are equal."""
    known = {name: number(value) for name, value in values.items() if value is not None}
    least = min((value for value in values.values() if value is not None), default=None)
    best = [name for name, text in known.items() if text == number(least)]
    others = [f"{name} {text}" for name, text in known.items() if name not in best]
    if not others:
        return ""
    return f"{words} {' and '.join(best)} with {number(least)} {unit} ({', '.join(others)})."


def _view(run: RunView) -> HandView | None:
    """Return the view of a run's first hand with estimates, None without any."""
    return next((view for view in run.hands() if view.errors_mm), None)


def _differences(names: list[str], differences: Differences) -> str:
    if not differences.fields:
        return "<p>Nothing.</p>"
    rows = [(path, *values) for path, values in differences.fields.items()]
    cells = [[escape(text) for text in row] for row in rows]
    texts = range(1, len(names) + 1)
    return markup_table("Fields that are not equal in all runs", ("field", *names), cells, texts=texts)


def _runs(runs: Mapping[str, RunView]) -> str:
    facts = ("folder", "scenario", "mode", "source", "seed", "duration, s", "active estimator", "command")
    rows = []
    for name, run in runs.items():
        s = run.summary
        about = (s["scenario"], s["mode"], s["source"], f"{s['seed']}", f"{s['duration_s']:g}", s["active_estimator"])
        rows.append((name, str(run.logs.run_dir), *about, s["command"] or "-"))
    texts = [i + 1 for i, fact in enumerate(facts) if fact not in _NUMBERS]
    return table("Where the figures come from", ("run", *facts), rows, texts=texts)
