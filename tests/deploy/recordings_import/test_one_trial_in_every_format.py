"""One synthetic trial as JIGSAWS file, CSV, Parquet, MCAP, rosbag2 and LeRobot set gives one score."""

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from tests.deploy.recordings_import.foreign_files import lerobot_set, ros_mcap, rosbag
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario
from tis.deploy.recordings_import.command import import_recording
from tis.deploy.recordings_import.found import Wanted
from tis.deploy.run.conclude import Outputs
from tis.deploy.run.virtual import run_virtual
from tis.deploy.tools.synth import write_trials

QUIET = Console(quiet=True)
LOSS = {"kind": "bernoulli", "p_loss": 0.1}
JIGSAWS_RUN = "jigsaws_run"  # beside the people's folder


def imported(source: Path, out_file: Path, episode: int = 0) -> Path:
    assert import_recording(source, out_file, Wanted(episode=episode), None, {}, QUIET, QUIET) == 0
    return out_file


def scenario_of(source: dict[str, Any]) -> Scenario:
    raw = {
        "version": 1,
        "name": "s",
        "duration_s": 3,
        "source": {**source, "hands": ["left", "right"]},
        "network": {"forward": {"delay": {"kind": "constant", "delay_ms": 120}, "loss": LOSS}},
        "identification": {"train": "own_head", "train_samples": 150, "block_rows": 3},
        "estimators": ["hold", "moesp_kf"],  # whose models are quick to find: each imported trial needs its own
        "active_estimator": "moesp_kf",
    }
    return build_scenario(raw, "s.yaml")


def twin(scenario: Scenario, run_dir: Path) -> Path:
    run_virtual(scenario, run_dir, None, QUIET, QUIET, Outputs(report=False, merge=False))
    return run_dir


def jigsaws(trial: Path) -> dict[str, Any]:
    return {
        "kind": "jigsaws",
        "path": str(trial.parents[3]),
        "trial": "S001",
        "pairing": "cross",
        "clock": "as_recorded",
    }


def numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for key, below in value.items():
            yield from numbers(below, f"{path}/{key}")
    elif isinstance(value, list):
        for i, below in enumerate(value):
            yield from numbers(below, f"{path}/{i}")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, float(value)


def scores(scenario: Scenario, run_dir: Path) -> dict[str, float]:
    summary = json.loads((twin(scenario, run_dir) / "summary.json").read_text())
    wanted = ("accuracy", "accuracy_by_hand", "orientation_deg", "gripper_rad")
    return dict(numbers({name: summary[name] for name in wanted}))


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("synth") / "people"
    [file] = write_trials(folder, 1, "Suturing", 3, 10.0, "tis synth", None)
    return file


@pytest.fixture(scope="module")
def expected(trial: Path) -> dict[str, float]:
    found = scores(scenario_of(jigsaws(trial)), trial.parents[4] / JIGSAWS_RUN)
    assert len(found) > 30
    assert found["/accuracy/hold/rmse_3d_mm"] > 0.1
    return found


def columns_of(trial: Path, folder: Path) -> dict[str, Any]:
    table = pq.read_table(imported(trial, folder / "trial.parquet"))
    return {name: table.column(name).to_numpy() for name in table.column_names}


def of_csv(trial: Path, folder: Path) -> Path:
    return imported(trial, folder / "t.csv")


def of_parquet(trial: Path, folder: Path) -> Path:
    return imported(trial, folder / "t.parquet")


def of_bag(trial: Path, folder: Path) -> Path:
    return imported(rosbag(folder / "bag", columns_of(trial, folder)), folder / "t.parquet")


def of_bag_in_mcap(trial: Path, folder: Path) -> Path:
    bag = rosbag(folder / "bag", columns_of(trial, folder), "mcap", transforms=("PSM1", "MTMR"))
    return imported(bag, folder / "t.csv")


def of_ros_mcap(trial: Path, folder: Path) -> Path:
    return imported(ros_mcap(folder / "ros.mcap", columns_of(trial, folder)), folder / "t.csv")


def of_own_log(trial: Path, folder: Path) -> Path:
    """A log holds the samples that were sent, from row 0 on."""
    whole = scenario_of(jigsaws(trial)).model_dump(mode="json", exclude_none=True)
    whole |= {"rate_hz": 30, "duration_s": 9.9, "estimators": ["hold"], "active_estimator": "hold"}
    whole["source"]["start"] = 0
    whole["identification"] = {"train": str(trial.parents[4] / JIGSAWS_RUN / "model.json")}
    run = twin(build_scenario(whole, "log"), folder / "log")
    return imported(run / "surgeon.mcap", folder / "t.parquet")


def of_lerobot_2(trial: Path, folder: Path) -> Path:
    return imported(lerobot_set(folder / "set", columns_of(trial, folder), 2), folder / "t.parquet", episode=1)


def of_lerobot_3(trial: Path, folder: Path) -> Path:
    return imported(lerobot_set(folder / "set", columns_of(trial, folder), 3), folder / "t.csv", episode=1)


@pytest.mark.parametrize(
    "make",
    [of_csv, of_parquet, of_bag, of_bag_in_mcap, of_ros_mcap, of_own_log, of_lerobot_2, of_lerobot_3],
)
def test_scores_are_those_of_the_jigsaws_file(
    trial: Path, expected: dict[str, float], tmp_path: Path, make: Callable[[Path, Path], Path]
) -> None:
    scenario = scenario_of({"kind": "table", "path": str(make(trial, tmp_path))})
    found = scores(scenario, tmp_path / "run")
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert math.isclose(found[name], value, rel_tol=1e-9, abs_tol=1e-9), name
    # angles between orientations, which are all that is scored, are the same with their components in another order
    both = (load_recording(scenario_of(jigsaws(trial))), load_recording(scenario))
    for one, other in zip(*(recording.hands for recording in both), strict=True):
        for its, read in ((one.command, other.command), (one.follower, other.follower)):
            n_rows = min(len(its), len(read))
            assert n_rows > 250
            alike = np.abs(np.sum(its.orientation[:n_rows] * read.orientation[:n_rows], axis=1))
            assert alike == pytest.approx(np.ones(n_rows), abs=1e-9)


def test_single_precision_gives_scores_to_its_precision(
    trial: Path, expected: dict[str, float], tmp_path: Path
) -> None:
    folder = lerobot_set(tmp_path / "set", columns_of(trial, tmp_path), 3, single=True)
    table = imported(folder, tmp_path / "t.parquet", episode=1)
    found = scores(scenario_of({"kind": "table", "path": str(table)}), tmp_path / "run")
    # 24 bits of a position below 0.5 m are 3e-5 mm
    rmse = [name for name in expected if name.endswith("rmse_3d_mm")]
    assert rmse
    for name in rmse:
        assert found[name] == pytest.approx(expected[name], abs=1e-4)
        assert found[name] != expected[name]


def test_the_imported_rows_are_the_trials_own(trial: Path, tmp_path: Path) -> None:
    columns = columns_of(trial, tmp_path)
    rows = np.loadtxt(trial)
    assert np.array_equal(columns["MTML_x_m"], rows[:, 0])
    assert np.array_equal(columns["PSM2_z_m"], rows[:, 59])
    assert np.array_equal(columns["PSM1_gripper_rad"], rows[:, 56])
    assert np.array_equal(columns["time_s"], np.arange(len(rows)) / 30)
