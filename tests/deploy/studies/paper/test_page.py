"""The page, from made-up results and from a real trial."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.markdown_tables import ragged_rows
from tests.patient_side.arm_models import static_model
from tis.deploy.compare.cells.cell import run_cell
from tis.deploy.studies.paper.cells import (
    METHODS,
    PAIRINGS,
    READINGS,
    ROWS,
    Cell,
    Results,
    Simulated,
    Trial,
    all_cells,
    few_cells,
    meaningful,
    scenario_of,
    scores_of,
    twin_of,
)
from tis.deploy.studies.paper.page import page
from tis.deploy.tools.synth import write_trials
from tis.patient_side.identification.model_file import dump_models

TRIAL = Trial(None, "Suturing", "D002", 7)


def _score(r2: float) -> dict[str, object]:
    return {"r2_pct": [r2, r2, r2], "rmse_normalized": [0.1, 0.2, None], "ratio_to_hold": 0.5}


def made_up_results(r2: float) -> Results:
    cells = {cell: {n: _score(r2) for n in ("paper", "paper_as_printed", "moesp_kf", "hold")} for cell in all_cells()}
    simulated = {
        (pairing, row.number, reading, as_printed): Simulated(_score(r2), float(row.number))
        for pairing in PAIRINGS
        for row in ROWS
        for reading in READINGS
        if meaningful(row, reading)
        for as_printed in (False, True)
    }
    models = {(pairing, method): static_model() for pairing in PAIRINGS for method in METHODS}
    return Results(TRIAL, "Suturing_D002", models, simulated, {(1e-3, 1e-3): _score(r2)}, cells)


def test_rows_are_judged_against_the_paper_on_every_axis() -> None:
    assert "5 of 5 lie within 8 points" in page(made_up_results(95.6)).replace("\n", " ")
    text = page(made_up_results(80.0)).replace("\n", " ")
    assert "0 of 5 lie within 8 points" in text
    assert "Row 1 as samples differs by -17.5 points." in text


def test_missing_figures_are_dashes_and_every_table_row_has_its_columns() -> None:
    text = page(made_up_results(90.0))
    assert "0.100 0.200 -" in text
    assert ragged_rows(text) == []


def test_a_quick_page_has_one_table_and_says_what_it_left_out() -> None:
    whole = made_up_results(90.0)
    text = page(replace(whole, cells={cell: whole.cells[cell] for cell in few_cells()}))
    assert [line for line in text.splitlines() if line.startswith(("### teleop", "### observer"))] == [
        "### teleoperation, true pair, held out"
    ]
    assert "made with --quick: 1 of 8 such tables were computed" in text
    assert text.partition("## How to read it")[0] == page(whole).partition("## How to read it")[0]
    assert text.partition("## How to repeat it")[2] == page(whole).partition("## How to repeat it")[2]
    assert 8 * len(few_cells()) == len(all_cells())


def test_row_6_as_samples_is_computed_nowhere() -> None:
    assert not any(cell.row.number == 6 and cell.reading == "samples" for cell in all_cells())
    assert "| 6 | samples |" not in page(made_up_results(90.0))


def test_a_cell_asks_for_what_it_says(tmp_path: Path) -> None:
    write_trials(tmp_path / "trials", 1, "Suturing", 1, 10.0, "a test")
    model_file = tmp_path / "models.json"
    model_file.write_bytes(dump_models([static_model()]))
    trial = Trial(str(tmp_path / "trials"), "Suturing", "S001", 7)
    cell = Cell(ROWS[3], "samples", "cross", "observer", "held out", "moesp")
    scenario = twin_of(cell, trial, 2214, model_file).scenario
    assert scenario.source.start == 1240
    assert scenario.n_samples == 2214 - 1240 - 1
    delay = scenario.network.forward.delay
    assert delay is not None
    assert delay.kind == "uniform"
    assert delay.low_ms == delay.high_ms == pytest.approx(5 * 1000 / 30)
    assert [rule.key for rule in scenario.generated_rules()] == ["tis/MTML/measured_cp", "tis/MTMR/measured_cp"]
    whole = twin_of(replace(cell, sample="in sample", reading="ms"), trial, 2214, model_file).scenario
    assert (whole.source.start, whole.n_samples) == (0, 2213)


def test_one_cell_on_a_real_trial(jigsaws_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tis.common.runtime.recordings import load_recording, load_training
    from tis.patient_side.build import identify_models

    monkeypatch.setenv("TIS_JIGSAWS", str(jigsaws_dir))
    scenario = scenario_of(TRIAL, "cross")
    recording = load_recording(scenario)
    models = identify_models(scenario, recording, load_training(scenario, recording))
    cell = Cell(ROWS[3], "samples", "cross", "teleoperation", "held out", "moesp")
    (tmp_path / "models.json").write_bytes(dump_models(models))
    twin = twin_of(cell, TRIAL, len(recording), tmp_path / "models.json")
    scores = scores_of(run_cell(twin, None))
    assert set(scores) == {"hold", "moesp_kf"}
    assert scores["hold"]["n_scored"] > 800
    assert scores["moesp_kf"]["ratio_to_hold"] < 0.7
