"""Command `tis paper`: identification, simulation, twins and the page."""

from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.progress import Progress

from common.errors import EXIT_OK
from common.runtime.recordings import load_recording, load_training
from common.scenario import Scenario
from deploy.paper.cells import Method, Pairing, Trial, run_cells, scenario_of
from deploy.paper.paper_page import page
from deploy.paper.printed import ROWS
from deploy.paper.results import METHODS, PAIRINGS, READINGS, Results, SimulationKey, all_cells, meaningful
from deploy.paper.simulation import Simulated, simulate
from deploy.shell import run_dir as folder
from deploy.shell.outputs import check_outputs
from patient_side.build import identify_models
from patient_side.identification.model_io import dump_models
from patient_side.statespace import ArmModel

EPSILONS: Final = ((1e-3, 1e-3), (1e-2, 1e-3), (1e-1, 1e-3), (1e-3, 1e-2))


def compute(trial: Trial, n_jobs: int | None, progress: Progress) -> Results:
    """Identify the models, run the paper's simulation and all twins; raises `DataError`."""
    models: dict[tuple[Pairing, Method], ArmModel] = {}
    simulated: dict[SimulationKey, Simulated] = {}
    for pairing in PAIRINGS:
        for method in METHODS:
            models[pairing, method] = _identified(scenario_of(trial, pairing, method))
        recording = load_recording(scenario_of(trial, pairing))
        for row in ROWS:
            for reading in READINGS:
                if not meaningful(row, reading):
                    continue
                for as_printed in (False, True):
                    key = (pairing, row.number, reading, as_printed)
                    model = models[pairing, "moesp_paper"]
                    hand = recording.hands[0]
                    simulated[key] = simulate(row, reading, model, hand, recording.rate_hz, trial.seed, as_printed)
    cells = all_cells()
    task = progress.add_task("twins", total=len(cells))
    texts = {key: dump_models([model]) for key, model in models.items()}
    scores = run_cells(cells, trial, texts, n_jobs, lambda: progress.advance(task))
    return Results(trial, recording.label, models, simulated, _epsilon_scores(trial), scores)


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


def write_paper(trial: Trial, out_file: Path, n_jobs: int | None, out: Console, err: Console) -> int:
    """Compute everything, write the page and say where; raises `DataError`."""
    check_outputs(out_file)
    with Progress(console=err, transient=True) as progress:
        results = compute(trial, n_jobs, progress)
    folder.write(out_file, page(results))
    out.print(
        f"written to {out_file}: {len(results.cells)} twins, {len(results.simulated)} simulations", soft_wrap=True
    )
    return EXIT_OK
