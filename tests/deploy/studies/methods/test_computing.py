"""Computation of several methods: one that cannot be trained is a gap, and nothing else suffers from it."""

from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from tis.common.errors import DataError, Fault, InputError
from tis.deploy.compare.cells import cell as cells
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.workers import Processes
from tis.deploy.compare.plan import Plan
from tis.deploy.studies.methods import computing
from tis.deploy.studies.methods.computing import compute_methods
from tis.deploy.studies.methods.plans import Measure, Subject, plans_of
from tis.deploy.studies.methods.trials import QUICK, Trials
from tis.patient_side.build import identify_models

EXTENT = replace(QUICK, duration_s=4.0)
QUIET = Console(quiet=True)
NEEDED = Fault("estimators", "arx_kf", "needs another package: pip install -e '.[another]' in the clone")


def few_plans(subject: Subject) -> dict[Measure, Plan]:
    """Return one plan with few twins: what is tested is the same for all."""
    return {measure: plan for measure, plan in plans_of(subject).items() if measure in computing.UNTRAINED}


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch, in_this_process: None, quick_twins: None) -> None:
    monkeypatch.setattr(computing, "plans_of", few_plans)


def subjects(people: Trials, *methods: str) -> list[Subject]:
    return [Subject(method, people, EXTENT, 7) for method in methods]


def test_a_method_that_cannot_be_planned_is_a_gap_and_hold_is_read_beside_another(
    few: None, people: Trials, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_the_extra(subject: Subject) -> dict[Measure, Plan]:
        if subject.method == "arx_kf":
            raise InputError(NEEDED)
        return few_plans(subject)

    monkeypatch.setattr(computing, "plans_of", without_the_extra)
    hold, lacking, there = compute_methods(
        subjects(people, "hold", "arx_kf", "damped_velocity"), Store(tmp_path), Processes(1), QUIET
    )
    assert lacking.gaps == (str(NEEDED),)
    assert lacking.rows("accuracy") == []
    assert hold.gaps == there.gaps == ()
    assert [row["ratio_to_hold"] for row in hold.rows("accuracy")] == [1.0, 1.0]
    assert all(row["ratio_to_hold"] < 1 for row in there.rows("accuracy"))
    assert set(there.hands("accuracy", "100")) == {"S", "T"}


def test_a_learned_method_without_its_extra_is_told_before_anything_is_computed(
    few: None, people: Trials, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_the_extra(names: list[str]) -> None:
        raise InputError(Fault("identification", "method", f"needs another package to train {names[0]}"))

    monkeypatch.setattr(computing, "check_extra", without_the_extra)
    monkeypatch.setattr(computing, "run", _not_yet)
    said = Console(record=True, file=StringIO(), width=200)
    with pytest.raises(RuntimeError, match="computing begins"):
        compute_methods(subjects(people, "hold", "gpr", "damped_velocity"), Store(tmp_path), Processes(1), said)
    assert "gpr is left out: " in said.export_text()


def _not_yet(*_: object) -> None:
    raise RuntimeError("computing begins")


def test_a_method_that_cannot_be_trained_says_why_and_what_is_missing(
    few: None, people: Trials, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The training of one method fails, as it does where an extra is not installed."""

    def without_the_extra(scenario, recording, trainings, stage):  # type: ignore[no-untyped-def]
        if "arx_kf" in scenario.estimators:
            raise DataError(NEEDED)
        return identify_models(scenario, recording, trainings, stage)

    monkeypatch.setattr(cells, "identify_models", without_the_extra)
    hold, lacking, there = compute_methods(
        subjects(people, "hold", "arx_kf", "damped_velocity"), Store(tmp_path), Processes(1), QUIET
    )
    assert lacking.gaps[0] == str(NEEDED)
    assert lacking.gaps[1] == "twins missing: accuracy 4, loss 6, noise 4, reliability 2, fast 1"
    assert hold.gaps == there.gaps == ()


def test_where_nothing_can_be_planned_the_reason_is_raised(
    people: Trials, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(subject: Subject) -> dict[Measure, Plan]:
        raise InputError(NEEDED)

    monkeypatch.setattr(computing, "plans_of", nothing)
    with pytest.raises(InputError, match="needs another package"):
        compute_methods(subjects(people, "hold", "arx_kf"), Store(tmp_path), Processes(1), QUIET)


def test_a_second_call_computes_nothing_anew(few: None, people: Trials, tmp_path: Path) -> None:
    asked = subjects(people, "hold", "damped_velocity")
    first = compute_methods(asked, Store(tmp_path), Processes(1), QUIET)
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    second = compute_methods(asked, Store(tmp_path), Processes(1), QUIET)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == written
    assert second[1].outcome.n_resumed == len(second[1].outcome.cells) > 0
    assert second[1].rows("accuracy") == first[1].rows("accuracy")
