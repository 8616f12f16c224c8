"""The command's twins in a folder that is not there yet, of a trial that the test writes."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.workers import Processes
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.paper import command
from tis.deploy.studies.paper.cells import Trial, few_cells
from tis.deploy.studies.paper.command import EPSILONS
from tis.deploy.tools.synth import write_trials


def test_twins_and_their_models_go_to_a_new_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None
) -> None:
    write_trials(tmp_path / "trials", 1, "Suturing", 1, 1400 / 30, "a test")
    monkeypatch.setattr(command, "_simulated", lambda *given: given[-1].total("simulations", len(EPSILONS)) or {})
    monkeypatch.setattr(command, "_epsilon_scores", lambda _: {})
    cell = next(iter(few_cells()))
    with PhaseProgress(Console(file=io.StringIO())) as progress, Processes(1) as workers:
        trial, store = Trial(str(tmp_path / "trials"), "Suturing", "S001", 7), Store(tmp_path / "new" / "twins")
        found = command.compute(trial, [cell], store, workers, progress)
    assert list(found.cells) == [cell]
    assert {file.parent.name for file in (tmp_path / "new" / "twins").rglob("*.json")} == {"models", "cells"}
