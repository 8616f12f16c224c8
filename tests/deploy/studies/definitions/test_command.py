"""`tis compare --definitions` as a whole, on synthetic trials of two made-up people."""

import json
from pathlib import Path

import pytest

from tests.deploy.commands import call, call_in_one_line
from tests.markdown_tables import ragged_rows
from tis.deploy.studies.definitions.readings import plan_splits

SETTINGS = (
    "duration_s=3",
    "identification.train_samples=240",
    "identification.block_rows=2",
    "patient.orientation={methods: [hold], active: hold}",
)
SMALL = tuple(word for setting in SETTINGS for word in ("--set", setting))


@pytest.fixture
def folder(written_trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TIS_JIGSAWS", str(written_trials))
    return written_trials


def test_both_tables_are_printed_and_written(folder: Path, in_this_process: None) -> None:
    code, out, err = call("compare", "--definitions", *SMALL, "--json", "--out", "kept", "--page", "page.md")
    assert code == 0, err
    report = json.loads(out)
    assert report == json.loads(Path("kept/definitions.json").read_text())
    assert report["people"] == ["S", "T"]
    assert [row["row"] for row in report["rows"]] == list(range(1, 37))
    user, supertrial = report["rows"][:12], report["rows"][12:24]
    # two trials with two numbers: the same models either way
    assert [row["mm"] for row in user] == [row["mm"] for row in supertrial]
    for row in report["rows"]:
        assert row["mm"]["hold"] == sorted(row["mm"]["hold"])
    assert len(report["least_squares"]) == 4
    assert [entry["rows"] for entry in report["published"][:2]] == [list(range(1, 13)), list(range(1, 37))]
    assert [row["name"] for row in report["windows"]][:2] == ["hold", "innovations_kf"]
    assert {row["hand"] for row in report["windows"]} == {"left", "right"}
    assert report["missing"] == report["failed"] == []

    page = Path("page.md").read_text()
    assert ragged_rows(page) == []
    assert report["command"] in page
    assert str(folder) not in page
    for entry in report["published"]:
        assert entry["verdict"] in page
    assert "| 36 | own trial | MAE of an axis, up to it, 10 Hz |" in page

    # the terminal's tables fit, and a second call computes nothing
    code, out, err = call("compare", "--definitions", *SMALL, "--out", "kept")
    assert code == 0
    assert "models identified" not in err
    assert all(len(line) <= 80 for line in out.splitlines()[1:-1])
    assert "Shi 2022" in out


def test_it_needs_trials_of_two_people(folder: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone" / "Suturing" / "kinematics" / "AllGestures"
    alone.mkdir(parents=True)
    text = (folder / "Suturing" / "kinematics" / "AllGestures" / "Suturing_S001.txt").read_text()
    for number in (1, 2):
        (alone / f"Suturing_S00{number}.txt").write_text(text)
    code, _, err = call_in_one_line("compare", "--definitions", *SMALL, "--set", f"source.path={tmp_path / 'alone'}")
    assert code == 4
    assert "--definitions: needs trials of at least two people; found: S001, S002" in err
    code, _, err = call_in_one_line("compare", "--definitions", "--set", f"source.path={tmp_path / 'none'}")
    assert code == 4
    assert "does not exist" in err


def test_other_options_are_refused(folder: Path) -> None:
    code, _, err = call_in_one_line("compare", "default", "--definitions")
    assert code == 2
    assert "--definitions: must be given without a scenario" in err


def test_a_supertrial_is_left_out_with_all_its_trials(folder: Path) -> None:
    plan = plan_splits(("identification.train_samples=240",), None)
    trained = {training.label: training.trials for training in plan.trainings.values() if training.trials}
    assert trained == {"all trials but number 001": ("T002",), "all trials but number 002": ("S001",)}
    assert [(cell.setting, cell.trial) for cell in plan.cells] == [
        (split, trial) for split in ("user", "own", "supertrial") for trial in ("S001", "T002")
    ]
    assert len({cell.digest for cell in plan.cells}) == len(plan.cells)
    assert {cell.training for cell in plan.cells} == set(plan.trainings)
