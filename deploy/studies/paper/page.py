"""The page of `tis paper`, generated from results; only the paper's own figures are typed by hand."""

from collections.abc import Mapping, Sequence
from math import sqrt
from pathlib import Path
from typing import Any, Final

from tis.common.scenario.network.pipeline import Pipeline
from tis.common.units import NS_PER_MS
from tis.deploy.present.numbers import per_axis
from tis.deploy.present.table import Column, Table
from tis.deploy.studies.paper.cells import (
    BLOCK_ROWS,
    ORDER,
    PAIRINGS,
    READINGS,
    ROWS,
    SAMPLES,
    TEXT,
    TOPOLOGIES,
    TRAIN_SAMPLES,
    Cell,
    Method,
    Pairing,
    PaperRow,
    PaperText,
    Reading,
    Results,
    SimulationKey,
    meaningful,
)
from tis.deploy.studies.tables import filled
from tis.netem.stages.delay import latency_of

WITHIN_POINTS: Final = 8.0
_PAIR: Final[dict[Pairing, str]] = {"same_name": "same-name pair (columns 1-3 to 39-41)", "cross": "true pair"}
_READINGS: Final = [(row, reading) for row in ROWS for reading in READINGS if meaningful(row, reading)]
_FIRST: Final = [row for row in ROWS if row.number <= 5]
"""Rows whose networks make sense either way."""

Axis = float | None


def page(results: Results) -> str:
    """Return the page."""
    trial, model, true_pair = results.trial, results.models, results.models["cross", "moesp"]
    kind = "a static relation" if true_pair.static else "not static"
    return filled(
        Path(__file__).with_name("page.md"),
        label=results.label,
        task=trial.task,
        trial=trial.name,
        seed=trial.seed,
        order=ORDER,
        block_rows=BLOCK_ROWS,
        n_train=TRAIN_SAMPLES,
        points=f"{WITHIN_POINTS:g}",
        n_rows=len(_FIRST),
        **{f"radius_{pairing}": f"{model[pairing, 'moesp_paper'].spectral_radius:.4f}" for pairing in PAIRINGS},
        radius_noise=f"{model['cross', 'moesp_paper'].spectral_radius:.3f}",
        own_order=f"{true_pair.order} ({kind})",
        networks=_networks(),
        simulations=_simulations(results),
        n_near=_n_near(results, "samples"),
        n_near_ms=_n_near(results, "ms"),
        outside=_outside(results),
        epsilons=_epsilons(results),
        **_of_the_text(results),
        packets=_packets(results),
        **_better(results.cells),
    )


# The figures in the paper's text, which no row of its tables has, beside ours.


def _of_the_text(results: Results) -> dict[str, str]:
    """Return what the page says of them. Oracle: figures written by hand, test_text_section."""
    key = nearest_simulation(results)
    run, ours = f"row {key[1]} read as {key[2]}", results.simulated[key].score
    row = min(ROWS, key=lambda each: _distance(each.accuracy_pct, TEXT.accuracy_pct))
    printed: dict[str, PaperRow | PaperText] = {
        "the paper's text": TEXT,
        **{f"its table, row {each.number}": each for each in ROWS},
    }
    lines = {name: (each.accuracy_pct, each.rmse) for name, each in printed.items()}
    lines[f"ours, {run}"] = (ours["r2_pct"], ours["rmse_normalized"])
    rows = [
        (name, per_axis(accuracy_pct), per_axis(rmse, 4), per_axis(implied_deviation(accuracy_pct, rmse), 3))
        for name, (accuracy_pct, rmse) in lines.items()
    ]
    heads = ("", "accuracy in %, x y z", "RMSE, x y z", "implied deviation, x y z")
    # the deviations of x that printed figures imply
    found = [implied_deviation(each.accuracy_pct, each.rmse)[0] for each in printed.values()]
    known = [value for value in found if value is not None]
    return {
        "nearest_row": str(row.number),
        "of_table": f"{_distance(row.accuracy_pct, TEXT.accuracy_pct):.2f}",
        "nearest_run": run.replace(" read", ", read"),
        "of_ours": f"{_distance(ours['r2_pct'], TEXT.accuracy_pct):.2f}",
        "text": Table("", heads, rows).markdown(),
        "least": f"{min(known):.3f}",
        "most": f"{max(known):.3f}",
    }


def nearest_simulation(results: Results) -> SimulationKey:
    """Return the run of Algorithm 1 on the same-name pair whose accuracy is nearest to the text's on every axis."""
    own = [key for key in results.simulated if key[0] == "same_name" and not key[3]]
    return min(own, key=lambda key: _distance(results.simulated[key].score["r2_pct"], TEXT.accuracy_pct))


def implied_deviation(accuracy_pct: Sequence[Axis], rmse: Sequence[Axis]) -> list[Axis]:
    """Return the standard deviation of each axis that R\u00b2 in % and RMSE imply; None where one is unknown."""
    return [
        None if r2 is None or error is None or r2 >= 100 else error / sqrt(1 - r2 / 100)
        for r2, error in zip(accuracy_pct, rmse, strict=True)
    ]


def _distance(ours: Sequence[Axis], theirs: Sequence[float]) -> float:
    """Return the largest difference over the axes; infinite where one of ours is unknown."""
    pairs = zip(ours, theirs, strict=True)
    return max(float("inf") if one is None else abs(one - other) for one, other in pairs)


def _networks() -> str:
    rows = []
    for row in ROWS:
        delay = {"kind": "uniform", "low_ms": row.low_ms, "high_ms": row.high_ms}
        jitter = {"kind": "normal", "std_ms": row.jitter_ms}
        asked = latency_of(Pipeline.model_validate({"delay": delay, "jitter": jitter}), {})
        latency = (f"{value_ns / NS_PER_MS:.3f}" for value_ns in (asked.mean_ns, asked.std_ns))
        rows.append((str(row.number), row.delay_text, f"{row.jitter_ms:g}", f"{row.loss_pct:g}", *latency))
    asked_for = (Column("mean delay really asked for", "ms"), Column("its deviation", "ms"))
    return Table(
        "", ("row", Column("n_d", "ms"), Column("n_j", "ms"), Column("loss", "%"), *asked_for), rows
    ).markdown()


def _simulations(results: Results) -> str:
    """Return a table for each pairing: the paper's simulation beside what the paper prints."""
    heads = (
        "row", Column("reading", words=True), Column("mean delay", "samples"), "paper prints", "`paper`",
        f"within {WITHIN_POINTS:g}?", "`paper_as_printed`", "RMSE, paper prints", "RMSE, `paper`",
    )  # fmt: skip
    blocks = []
    for pairing in PAIRINGS:
        rows = []
        for row, reading in _READINGS:
            fixed = results.simulated[pairing, row.number, reading, False]
            printed = results.simulated[pairing, row.number, reading, True]
            rows.append(
                (
                    str(row.number),
                    reading,
                    f"{fixed.mean_delay_samples:.2f}",
                    per_axis(row.accuracy_pct),
                    per_axis(fixed.score["r2_pct"]),
                    _is_within(row, fixed.score["r2_pct"]),
                    per_axis(printed.score["r2_pct"]),
                    per_axis(row.rmse, 3),
                    per_axis(fixed.score["rmse_normalized"], 3),
                )
            )
        blocks.append(f"### {_PAIR[pairing].capitalize()}\n\n{Table('', heads, rows).markdown()}")
    return "\n\n".join(blocks)


def _epsilons(results: Results) -> str:
    rows = [
        (f"{q:g}", f"{r:g}", per_axis(score["r2_pct"]), per_axis(score["rmse_normalized"], 3))
        for (q, r), score in results.epsilons.items()
    ]
    return Table("", ("epsilon_Q", "epsilon_R", "R\u00b2 %, x y z", "RMSE, x y z"), rows).markdown()


def _packets(results: Results) -> str:
    """Return a table for each topology, pairing and sample that was computed: with --quick one."""
    names: dict[str, Method] = {
        "paper": "moesp_paper",
        "paper_as_printed": "moesp_paper",
        "moesp_kf": "moesp",
        "hold": "moesp",
    }
    ours = [f"`{name}`" for name in names]
    heads: list[Column | str] = ["row", Column("reading", words=True), "paper prints", *ours, "`moesp_kf` / hold"]
    all_tables = [(t, pairing, sample) for t in TOPOLOGIES for pairing in PAIRINGS for sample in SAMPLES]
    blocks = []
    for topology, pairing, sample in all_tables:
        if Cell(ROWS[0], READINGS[0], pairing, topology, sample, "moesp") not in results.cells:
            continue
        rows = []
        for row, reading in _READINGS:
            scores = {
                name: results.cells[Cell(row, reading, pairing, topology, sample, method)][name]
                for name, method in names.items()
            }
            found = [per_axis(score["r2_pct"]) for score in scores.values()]
            ratio = f"{scores['moesp_kf']['ratio_to_hold']:.2f}"
            rows.append((str(row.number), reading, per_axis(row.accuracy_pct), *found, ratio))
        table = Table("", heads, rows)
        blocks.append(f"### {topology}, {_PAIR[pairing]}, {sample}\n\n{table.markdown()}")
    n = len(all_tables)
    if len(blocks) < n:
        blocks.append(f"This page was made with --quick: {len(blocks)} of {n} such tables were computed.")
    return "\n\n".join(blocks)


def _better(cells: Mapping[Cell, Mapping[str, Any]]) -> dict[str, str]:
    """Return what the testbed's filter does on the true pair, with everything delayed, on held-out rows."""
    ours = {
        (row, reading): cells[Cell(row, reading, "cross", "teleoperation", "held out", "moesp")]["moesp_kf"]
        for row, reading in _READINGS
    }
    ratios = [score["ratio_to_hold"] for score in ours.values()]
    beaten = [
        all(r2 >= paper for r2, paper in zip(score["r2_pct"], row.accuracy_pct, strict=True))
        for (row, _), score in ours.items()
        if row in _FIRST
    ]
    return {
        "best": f"{min(ratios):.2f}",
        "worst": f"{max(ratios):.2f}",
        "n_beaten": str(sum(beaten)),
        "n_readings": str(len(beaten)),
    }


def _n_near(results: Results, reading: Reading) -> int:
    """Return how many of the first rows are near the paper on the same-name pair."""
    scores = {row: results.simulated["same_name", row.number, reading, False].score["r2_pct"] for row in _FIRST}
    return sum(_is_within(row, r2) == "yes" for row, r2 in scores.items())


def _is_within(row: PaperRow, r2_pct: Sequence[Axis]) -> str:
    return "yes" if _distance(r2_pct, row.accuracy_pct) <= WITHIN_POINTS else "no"


def _outside(results: Results) -> str:
    """Return a text on those of rows 1-5, read as samples on the same-name pair, that differ by more."""
    sentences = []
    drawn = {row: results.simulated["same_name", row.number, "samples", False] for row in _FIRST}
    for row, simulated in drawn.items():
        r2, delay = simulated.score["r2_pct"], simulated.mean_delay_samples
        if _is_within(row, r2) == "yes":
            continue
        off = max((ours - paper for ours, paper in zip(r2, row.accuracy_pct, strict=True)), key=abs)
        sentences.append(f"Row {row.number} as samples differs by {off:+.1f} points.")
        better = [other for other in _FIRST if sum(other.accuracy_pct) > sum(row.accuracy_pct)]
        longer = [other for other in better if drawn[other].mean_delay_samples > delay]
        if longer:
            sentences.append(
                f"The paper prints less for it than for row {longer[0].number}, although its delays are shorter on "
                f"average ({delay:.2f} against {drawn[longer[0]].mean_delay_samples:.2f} samples): on the same draws "
                "the repaired filter does not do that."
            )
    return " ".join(sentences) or "No row differs by more."
