"""Units computed from their shipped files alone, against the same units computed at home."""

import pickle
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.deploy.compare.untimed import untimed
from tests.documented_estimator import FILE, NAME, documented_estimator
from tis.deploy.compare.cells.cell import Cell, Training
from tis.deploy.compare.cells.identity import content_digest
from tis.deploy.compare.engine.shipment import perform_away, shipment_of, shipped_files
from tis.deploy.compare.engine.workers import Computed, Failure, Result, Unit, perform
from tis.deploy.compare.plan import Plan, Request, make_plan
from tis.patient_side.models import own_estimators

SYNTHETIC = ("identification.train_samples=120", "identification.order=0", "identification.block_rows=2")


def packed(unit: Unit, model_file: Path | None) -> tuple[bytes, dict[str, bytes]]:
    """What a worker gets: the pickled shipment, and the content of each file."""
    own = own_estimators(unit.scenario)
    contents = {name: path.read_bytes() for name, path in shipped_files(unit, model_file, own).items()}
    digests = {name: content_digest(content) for name, content in contents.items()}
    return pickle.dumps(shipment_of(unit, digests, own)), contents


def away(unit: Unit, model_file: Path | None, folder: Path) -> Result:
    return perform_away(*packed(unit, model_file), str(folder))


def scores(result: Result) -> Mapping[str, Any]:
    assert isinstance(result, Computed), result
    return (
        untimed({"": result.result})[""]
        if "hands" in result.result
        else {**result.result, "train_s": None, "process_s": None}
    )


def first_units(plan: Plan, tmp_path: Path) -> tuple[Training, Cell, Path]:
    """The first training with the first of its cells, and the file of the models, identified at home."""
    training = next(iter(plan.trainings.values()))
    cell = next(cell for cell in plan.cells if cell.training == training.digest)
    made = perform(training, None)
    assert isinstance(made, Computed)
    assert made.models is not None
    (tmp_path / "kept.json").write_bytes(made.models)
    return training, cell, tmp_path / "kept.json"


@pytest.mark.parametrize("train", ["others", "own_head"])
def test_recorded_trials_are_read_from_what_was_shipped(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, train: str
) -> None:
    plan = make_plan(Request(str(small), (f"identification.train={train}",), duration_s=4.0))
    training, cell, model_file = first_units(plan, tmp_path)
    at_home = [perform(training, None), perform(cell, model_file)]
    shipped = [packed(training, None), packed(cell, model_file)]
    assert sorted(shipped[0][1]) == (["trials/S001", "trials/T002"] if train == "others" else ["trials/S001"])
    assert sorted(shipped[1][1]) == ["model.json", "trials/S001"]
    # The worker has no folder of trials.
    assert cell.scenario.source.kind == "jigsaws"
    monkeypatch.setenv("TIS_JIGSAWS", str(tmp_path / "absent"))
    nowhere = [pickle.loads(shipment) for shipment, _ in shipped]
    lost = [replace(one, unit=replace(one.unit, scenario=elsewhere(one.unit))) for one in nowhere]
    there = str(tmp_path / "w")
    found = [perform_away(pickle.dumps(one), files, there) for one, (_, files) in zip(lost, shipped, strict=True)]
    assert [scores(one) for one in found] == [scores(one) for one in at_home]
    assert isinstance(found[0], Computed)
    assert found[0].models == model_file.read_bytes()


def elsewhere(unit: Unit) -> Any:
    """The unit's scenario with a folder of trials that is not there."""
    scenario = unit.scenario
    return scenario.model_copy(update={"source": scenario.source.model_copy(update={"path": "/absent"})})


def test_traces_and_a_given_model_file_are_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _, _, model_file = first_units(make_plan(Request("default", SYNTHETIC, n_seeds=1, duration_s=3.0)), tmp_path)
    Path("trace.csv").write_text("sent_s,delay_ms\n0,40\n1,90\n")
    network = "network={forward: {delay: {kind: trace, path: trace.csv}}}"
    settings = (network, f"identification={{train: {model_file}}}", "source.start=240")
    (cell,) = make_plan(Request("default", settings, n_seeds=1, duration_s=3.0)).cells
    at_home, shipped = perform(cell, None), packed(cell, None)
    assert sorted(shipped[1]) == ["model.json", "traces/0"]
    for file in (Path("trace.csv"), model_file):
        file.unlink()
    assert scores(perform_away(*shipped, str(tmp_path / "w"))) == scores(at_home)


def test_own_estimators_are_shipped_and_a_changed_one_is_read_anew(own_folder: Path) -> None:
    module, kept = own_folder / FILE, list(sys.path)
    settings = (*SYNTHETIC, f"estimators=[hold, '{NAME}']", "active_estimator=hold")
    of_worker: dict[str, ModuleType] = {}

    def answer(text: str) -> Any:
        # At home.
        module.write_text(text)
        plan = make_plan(Request("default", settings, n_seeds=1, duration_s=4.0))
        _, cell, model_file = first_units(plan, own_folder)
        shipped, at_home = packed(cell, model_file), scores(perform(cell, model_file))
        # On the worker, whose current folder has no such module, and which keeps what it has imported.
        module.unlink()
        sys.modules.pop(module.stem)
        sys.modules.update(of_worker)
        found = scores(perform_away(*shipped, str(own_folder / "w")))
        assert found == at_home
        of_worker[module.stem] = sys.modules.pop(module.stem)
        sys.path[:] = kept
        return found["hands"]["left"]["estimators"][NAME]["sse_m2"]

    first = answer(documented_estimator())
    assert answer(documented_estimator().replace("ALPHA * off_m", "0.5 * ALPHA * off_m")) != first


def test_another_version_of_installed_code_is_refused(own_folder: Path) -> None:
    """A package is not shipped: what the worker has must be what the client has."""
    (own_folder / "mine").mkdir()
    (own_folder / "mine" / "__init__.py").write_text("")
    (own_folder / "mine" / FILE).write_text(documented_estimator())
    settings = (*SYNTHETIC, f"estimators=[hold, 'mine.{NAME}']", "active_estimator=hold")
    _, cell, model_file = first_units(make_plan(Request("default", settings, n_seeds=1, duration_s=4.0)), own_folder)
    shipment, contents = packed(cell, model_file)
    assert sorted(contents) == ["model.json"]
    shipped = pickle.loads(shipment)
    name, origin = next(iter(shipped.origins.items()))
    foreign = replace(shipped, origins={name: replace(origin, sha256="0" * 64)})
    result = perform_away(pickle.dumps(foreign), contents, str(own_folder / "w"))
    assert isinstance(result, Failure)
    assert result.reason.startswith(f"mine.{NAME}: the worker has another mine/{FILE}")


def test_a_folder_that_cannot_be_written_fails_the_unit_by_name(tmp_path: Path) -> None:
    _, cell, model_file = first_units(make_plan(Request("default", SYNTHETIC, n_seeds=1, duration_s=3.0)), tmp_path)
    (tmp_path / "file").write_text("")
    result = away(cell, model_file, tmp_path / "file")
    assert isinstance(result, Failure)
    assert result.reason == f"{tmp_path / 'file'}: cannot be written: Not a directory"


def test_a_failure_names_the_folder_of_the_client(small: Path, tmp_path: Path) -> None:
    plan = make_plan(Request(str(small), duration_s=4.0))
    _, cell, model_file = first_units(plan, tmp_path)
    shipment, contents = packed(cell, model_file)
    contents["trials/S001"] = b"1 2 3\n"
    home = pickle.loads(shipment).home
    result = perform_away(shipment, contents, str(tmp_path / "w"))
    assert isinstance(result, Failure)
    assert result.reason.startswith(f"{home}/Suturing/kinematics/AllGestures/Suturing_S001.txt")
