"""Command `tis paper`: identification, simulation, twins and the page."""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK
from tis.common.extras import GET_REPORT
from tis.common.runtime.recordings import load_recording, load_training
from tis.common.scenario import Scenario
from tis.common.sources.trajectory import Recording
from tis.deploy.compare.cells.store import Store, resumable
from tis.deploy.compare.engine.compute import compute as compute_twins
from tis.deploy.compare.engine.compute import workers_of
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs, check_outputs_in
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.paper.cells import (
    METHODS,
    PAIRINGS,
    READINGS,
    ROWS,
    Cell,
    Method,
    Pairing,
    Results,
    Simulated,
    SimulationKey,
    Trial,
    all_cells,
    few_cells,
    meaningful,
    scenario_of,
    scores_of,
    simulate,
    twin_of,
)
from tis.deploy.studies.paper.page import page
from tis.patient_side.build import identify_models
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.statespace import ArmModel

FIGURES: Final = ("positions_same_name", "positions_true_pair", "singular_values")
FORMATS: Final = ("svg", "pdf")
EPSILONS: Final = ((1e-3, 1e-3), (1e-2, 1e-3), (1e-1, 1e-3), (1e-3, 1e-2))


def compute(trial: Trial, cells: Sequence[Cell], store: Store, workers: Workers, progress: PhaseProgress) -> Results:
    """Identify the models, run the paper's simulation and the twins of ``cells``; raises `DataError`."""
    progress.total("models", len(PAIRINGS) * len(METHODS))
    models: dict[tuple[Pairing, Method], ArmModel] = {}
    for pairing in PAIRINGS:
        for method in METHODS:
            models[pairing, method] = _identified(scenario_of(trial, pairing, method))
            progress.advance("models")
    recordings = {pairing: load_recording(scenario_of(trial, pairing)) for pairing in PAIRINGS}
    simulated = _simulated(trial, models, recordings, progress)
    epsilons = _epsilon_scores(trial)
    progress.advance("simulations", len(EPSILONS))
    # the same filters on packets
    place = folder.made(store.path / "models")
    files = {key: place / f"{'_'.join(key)}.json" for key in models}
    for key, model in models.items():
        folder.write(files[key], dump_models([model]))
    twins = {
        cell: twin_of(cell, trial, len(recordings[cell.pairing]), files[cell.pairing, cell.method]) for cell in cells
    }
    outcome = compute_twins(list(twins.values()), {}, store, workers, progress)
    outcome.check()
    scores = {cell: scores_of(outcome.cells[twin.digest]) for cell, twin in twins.items()}
    return Results(trial, recordings["cross"].label, models, simulated, epsilons, scores)


def _simulated(
    trial: Trial,
    models: Mapping[tuple[Pairing, Method], ArmModel],
    recordings: Mapping[Pairing, Recording],
    progress: PhaseProgress,
) -> dict[SimulationKey, Simulated]:
    """Return the paper's simulation, in each reading of its delays."""
    keys = [
        (pairing, row, reading, as_printed)
        for pairing in PAIRINGS
        for row in ROWS
        for reading in READINGS
        if meaningful(row, reading)
        for as_printed in (False, True)
    ]
    progress.total("simulations", len(keys) + len(EPSILONS))
    found: dict[SimulationKey, Simulated] = {}
    for pairing, row, reading, as_printed in keys:
        hand, rate_hz = recordings[pairing].hands[0], recordings[pairing].rate_hz
        model = models[pairing, "moesp_paper"]
        found[pairing, row.number, reading, as_printed] = simulate(
            row, reading, model, hand, rate_hz, trial.seed, as_printed
        )
        progress.advance("simulations")
    return found


def _identified(scenario: Scenario) -> ArmModel:
    recording = load_recording(scenario)
    return identify_models(scenario, recording, load_training(scenario, recording))[0]


def _epsilon_scores(trial: Trial) -> dict[tuple[float, float], dict[str, Any]]:
    """Return the paper's simulation of row 3 in samples, same-name pairing, for several initial values of Q and R."""
    row = ROWS[2]
    scenario = scenario_of(trial, "same_name", "moesp_paper")
    recording = load_recording(scenario)
    scores = {}
    for epsilon_q, epsilon_r in EPSILONS:
        guess = {"epsilon_q": epsilon_q, "epsilon_r": epsilon_r}
        changed = scenario.model_copy(update={"identification": scenario.identification.model_copy(update=guess)})
        model = _identified(changed)
        hand = recording.hands[0]
        scores[epsilon_q, epsilon_r] = simulate(
            row, "samples", model, hand, recording.rate_hz, trial.seed, False
        ).score
    return scores


def write_paper(
    trial: Trial, path: Path, place: Path, quick: bool, n_jobs: int | None, out: Console, err: Console
) -> int:
    """Compute everything, or with ``quick`` one table of twins, and write page and figures; raises `DataError`.

    The figures lie in ``place``, beside the twins; without matplotlib there are none, which is said.
    """
    store, workers = Store(place), workers_of(n_jobs, None, err.print)
    names = [f"{name}.{form}" for name in FIGURES for form in FORMATS]
    check_outputs(path)
    check_outputs_in(store.path, *names)
    with workers, resumable(store, err), PhaseProgress(err) as progress:
        results = compute(trial, few_cells() if quick else all_cells(), store, workers, progress)
    folder.write(path, page(results))
    out.print(f"written to {path}: {len(results.cells)} twins, {len(results.simulated)} simulations", soft_wrap=True)
    if find_spec("matplotlib") is None:
        err.print(escape(f"no figures without matplotlib: {GET_REPORT}"), style="dim")
        return EXIT_OK
    from tis.deploy.report.publication.matplotlib_figures import rendered
    from tis.deploy.studies.paper.plots import drawn  # loads matplotlib

    for name, figure in zip(FIGURES, drawn(results), strict=True):
        for form in FORMATS:
            folder.write(place / f"{name}.{form}", rendered(figure, form))
    out.print(escape(f"{', '.join(names)} lie in {place}"), soft_wrap=True)
    return EXIT_OK
