"""`tis.deploy.logs.read.load`: a run as columns, against its logs read record by record with the mcap package."""

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from tests.deploy.logs.conftest import run_dir, scenario
from tests.deploy.report.partial import causes
from tis.common.errors import DataError, InputError
from tis.common.scenario import Scenario
from tis.deploy.report import OUTCOMES, load

__all__ = ["run_dir", "scenario"]


def _messages(path: Path, topic: str) -> list[tuple[Any, dict[str, Any]]]:
    with path.open("rb") as file:
        found = make_reader(file).iter_messages(topics=[topic], log_time_order=False)
        return [(message, json.loads(message.data)) for _, _, message in found]


def test_load_is_a_function_however_the_module_was_imported() -> None:
    module = importlib.import_module("tis.deploy.logs.read.load")
    assert callable(importlib.import_module("tis.deploy.report").load)
    assert module.load_run.__module__ == "tis.deploy.logs.read.load"


def test_messages_are_the_log_s(run_dir: Path) -> None:
    run = load(run_dir)
    for side, key in (("patient", "tis/MTML/measured_cp"), ("surgeon", "tis/PSM2/estimated_cp")):
        logged = _messages(run_dir / f"{side}.mcap", key)
        found = run.messages[side][key]  # type: ignore[index]
        assert found.seq.tolist() == [message.sequence for message, _ in logged]
        assert found.sent_ns.tolist() == [message.publish_time for message, _ in logged]
        assert found.log_ns.tolist() == [message.log_time for message, _ in logged]
        assert found.sample_ns.tolist() == [row["sample_ns"] for _, row in logged]
        assert found.command_sample_ns.tolist() == [row.get("command_sample_ns", -1) for _, row in logged]
        assert all(found.column(name).dtype == np.int64 for name in found.names)


def test_tracks_are_scored_as_the_summary_says(run_dir: Path) -> None:
    run = load(str(run_dir))
    assert run.summary is not None
    for hand in ("left", "right"):
        error_mm = run.error_mm("moesp_kf", hand)[run.tracks[hand].scored]
        expected = run.summary["accuracy_by_hand"][hand]["moesp_kf"]["rmse_3d_mm"]
        assert np.sqrt(np.mean(error_mm**2)) == pytest.approx(expected)
    with pytest.raises(InputError, match=r"estimator: must be one of hold, .*moesp_kf.*, plant \(got 'fnord'\)"):
        run.error_mm("fnord")
    with pytest.raises(InputError, match=r"hand: must be one of left, right \(got 'middle'\)"):
        run.error_mm("hold", "middle")  # type: ignore[arg-type]


def test_ticks_truth_and_fates_have_their_types_and_values(run_dir: Path, scenario: Scenario) -> None:
    run = load(run_dir)
    assert run.scenario == scenario
    assert run.problems == ()
    assert run.ticks["patient"].tick.tolist() == list(range(scenario.n_samples))
    assert run.ticks["patient"].missed.dtype == np.bool_
    assert run.truth["left"].position_m.shape == (scenario.n_samples + 1, 3)
    assert set(run.messages["surgeon"]) >= {"tis/MTML/measured_cp", "tis/MTMR/measured_cp"}
    link = run.summary["links"]["forward"] if run.summary else {}
    outcome = run.fates["forward"].outcome
    assert len(outcome) == link["offered"]
    assert np.count_nonzero(outcome == OUTCOMES.index("loss")) == link["dropped"]
    ages = run.ages["right"]
    assert len(ages.t_ns) == len(ages.age_ns) > 100
    assert (ages.age_ns > 0).all()


def test_a_missing_log_is_named_and_leaves_its_columns_empty(run_dir: Path, tmp_path: Path) -> None:
    for name in ("scenario.yaml", "patient.mcap"):
        (tmp_path / name).write_bytes((run_dir / name).read_bytes())
    run = load(tmp_path)
    assert causes(run.problems) == ["surgeon: log is missing", "netem: log is missing"]
    assert run.summary is None
    assert len(run.truth["left"].sample_ns) == len(run.fates["forward"].seq) == 0
    assert np.isnan(run.error_mm("hold")).all()


def test_a_folder_without_logs_is_refused(run_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no run folder"):
        load(tmp_path)
    (tmp_path / "scenario.yaml").write_bytes((run_dir / "scenario.yaml").read_bytes())
    with pytest.raises(DataError, match="holds no log"):
        load(tmp_path)


def test_what_is_no_direction_is_refused(run_dir: Path) -> None:
    with pytest.raises(InputError, match=r"direction: must be one of forward, feedback \(got 'sideways'\)"):
        load(run_dir).lost("sideways")  # type: ignore[arg-type]
