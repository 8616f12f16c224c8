"""Comparisons on tables: trials are files, people are named by them, and workers read what was shipped."""

import pickle
from pathlib import Path
from typing import Any

import pytest

from tests.common.runtime.recordings.tables import movement, write_csv
from tests.deploy.compare.untimed import untimed
from tis.common.errors import DataError, InputError
from tis.common.scenario import Scenario
from tis.deploy.compare.cells.cell import Cell, Training
from tis.deploy.compare.cells.identity import content_digest
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.engine.shipment import perform_away, shipment_of, shipped_files
from tis.deploy.compare.engine.workers import Computed, perform
from tis.deploy.compare.grid import Sweep
from tis.deploy.compare.plan import Plan, Request, make_plan
from tis.deploy.compare.results.pooled import person
from tis.deploy.compare.results.report import report

SCENARIO = """version: 1
name: tables
drain_s: 0.2
source: {kind: table, path: ann_1.csv}
network: {forward: {delay: {kind: constant, delay_ms: 100}}}
identification: {train_samples: 150, block_rows: 4, order: 0}
estimators: [hold, damped_velocity]
active_estimator: damped_velocity
"""


@pytest.fixture
def tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a scenario beside tables of Ann, Bob and Eve, 300 rows each, two of Ann."""
    for seed, name in enumerate(("ann_1", "ann_2", "bob_1", "eve_1")):
        write_csv(tmp_path / f"{name}.csv", movement(300, seed=seed, tremor_m=1e-4))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(SCENARIO)
    return tmp_path / "s.yaml"


def plan_of(file: Path, *settings: str, **changes: Any) -> Plan:
    return make_plan(Request(str(file), settings, **changes))


def path_of(scenario: Scenario) -> str:
    assert scenario.source.kind == "table"
    return Path(scenario.source.path).name


def test_a_table_is_one_trial_to_its_end(tables: Path) -> None:
    (cell,) = plan_of(tables).cells
    assert (cell.trial, cell.scenario.n_samples, path_of(cell.scenario)) == ("ann_1.csv", 149, "ann_1.csv")
    assert cell.scenario.identification.train == "own_head"
    assert plan_of(tables).source == "table"


def test_named_tables_and_people_are_compared(tables: Path) -> None:
    plan = plan_of(tables, "identification.train=others", trials=("ann_2.csv", "eve_1.csv"))
    assert [path_of(cell.scenario) for cell in plan.cells] == ["ann_2.csv", "eve_1.csv"]
    assert [person(cell) for cell in plan.cells] == ["ann", "eve"]
    assert [cell.scenario.n_samples for cell in plan.cells] == [299, 299]
    assert sorted(each.label for each in plan.trainings.values()) == ["all subjects but ann", "all subjects but eve"]
    named = plan_of(tables, trials=("ann_2.csv", "eve_1.csv"))
    assert named.trained_on == "the rows of each trial before its start"  # as the scenario says, whoever is beside it
    plan = plan_of(tables, people=("ann",))
    assert [cell.trial for cell in plan.cells] == ["ann_1.csv", "ann_2.csv"]
    with pytest.raises(InputError, match=r"no such trial; there are ann_1.csv, ann_2.csv, bob_1.csv, eve_1.csv"):
        plan_of(tables, trials=("ann_9.csv",))


def test_where_others_train_each_persons_tables_are_scored(tables: Path) -> None:
    plan = plan_of(tables, "identification.train=others")
    assert [cell.trial for cell in plan.cells] == ["ann_1.csv", "ann_2.csv", "bob_1.csv", "eve_1.csv"]


def test_the_report_says_the_network(tables: Path) -> None:
    found = report(plan_of(tables), Outcome(), "tis compare s.yaml")["network"]
    assert found == ["forward (west to east): delay 100 ms, sd 0", "feedback (east to west): nothing injected"]
    swept = plan_of(tables, sweeps=(Sweep("network.forward.delay.delay_ms", ("50", "200")),))
    found = report(swept, Outcome(), "")["network"]
    assert found[0].endswith("forward (west to east): delay 50 ms, sd 0")
    assert found[-1] == "other settings differ in network.forward.delay.delay_ms: 50, 200"


def test_a_table_that_is_not_there_is_refused_before_anything_is_computed(tables: Path) -> None:
    with pytest.raises(DataError, match=r"none\.csv: does not exist \(given by source.path, which counts from .*\)"):
        plan_of(tables, "source.path=none.csv")


def test_a_name_of_the_person_is_of_the_scenarios_own_table(tables: Path) -> None:
    plan = plan_of(tables, "source.person=Zoe", trials=("ann_1.csv", "ann_2.csv"))
    assert [person(cell) for cell in plan.cells] == ["Zoe", "ann"]


def test_workers_read_what_was_shipped(tables: Path, tmp_path: Path) -> None:
    plan = plan_of(tables, "identification.train=others", trials=("bob_1.csv",))
    [training], [cell] = plan.trainings.values(), plan.cells
    made = perform(training, None)
    assert isinstance(made, Computed)
    assert made.models is not None
    model_file = tmp_path / "kept.json"
    model_file.write_bytes(made.models)
    at_home = perform(cell, model_file)
    shipments = [_packed(training, None), _packed(cell, model_file)]
    assert sorted(shipments[0][1]) == [f"trials/{name}.csv" for name in ("ann_1", "ann_2", "bob_1", "eve_1")]
    assert sorted(shipments[1][1]) == ["model.json", "trials/bob_1.csv"]
    for file in tmp_path.glob("*.csv"):
        file.unlink()
    trained, scored = (perform_away(*shipment, str(tmp_path / "w")) for shipment in shipments)
    assert isinstance(trained, Computed)
    assert trained.models == made.models
    assert isinstance(scored, Computed)
    assert isinstance(at_home, Computed)
    assert untimed({"": scored.result}) == untimed({"": at_home.result})


def _packed(unit: Training | Cell, model_file: Path | None) -> tuple[bytes, dict[str, bytes]]:
    contents = {name: path.read_bytes() for name, path in shipped_files(unit, model_file, {}).items()}
    digests = {name: content_digest(content) for name, content in contents.items()}
    return pickle.dumps(shipment_of(unit, digests, {})), contents
