"""Trials: which are chosen, and the population that stands in for recordings."""

from pathlib import Path

import pytest

from tis.common.errors import DataError
from tis.deploy.studies.methods.trials import Trials, find_trials
from tis.deploy.tools.synth import write_trials

TRIALS = Trials(None, "Suturing", ("C001", "C002", "C003", "D001", "D004", "E002"), {})


def test_the_last_trial_of_each_person_stands_for_them() -> None:
    assert TRIALS.few(None) == ("C003", "D004", "E002")
    assert TRIALS.few(2) == ("C003", "D004")


def test_training_trials_come_by_turns_and_never_from_the_person_that_is_tested() -> None:
    assert TRIALS.others("D004") == ("C001", "E002", "C002", "C003")
    assert TRIALS.others("E002") == ("C001", "D001", "C002", "D004", "C003")


def test_own_trials_are_others_of_the_same_person_and_the_next_person_goes_round() -> None:
    assert TRIALS.own("C002") == ("C001", "C003")
    assert TRIALS.own("E002") == ()
    assert TRIALS.next_person("C002") == ("D001", "D004")
    assert TRIALS.next_person("E002") == ("C001", "C002", "C003")


def test_without_recordings_a_population_is_written_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)
    monkeypatch.chdir(tmp_path)
    found = find_trials(None, "Suturing", tmp_path, 3, 8.0)
    assert found.synthetic
    assert found.names == tuple(f"{letter}00{n}" for letter in "STUV" for n in (1, 2, 3))
    assert found.elsewhere == {}
    files = sorted(path.stat().st_mtime_ns for path in tmp_path.rglob("*.txt"))
    assert find_trials(None, "Suturing", tmp_path, 3, 8.0) == found
    assert sorted(path.stat().st_mtime_ns for path in tmp_path.rglob("*.txt")) == files


def test_a_folder_gives_its_trials_and_those_of_its_other_tasks(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    write_trials(folder, 1, "Suturing", 1, 8.0, "a test", 2)
    write_trials(tmp_path / "more", 1, "Knot_Tying", 1, 8.0, "a test", 2)
    (tmp_path / "more" / "Knot_Tying").rename(folder / "Knot_Tying")
    found = find_trials(str(folder), "Suturing", tmp_path, 1, 8.0)
    assert (found.names, found.elsewhere, found.synthetic) == (
        ("S001", "T001"),
        {"Knot_Tying": ("S001", "T001")},
        False,
    )


def test_a_folder_without_trials_or_with_one_person_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="does not exist"):
        find_trials(str(tmp_path / "nothing"), "Suturing", tmp_path, 1, 8.0)
    write_trials(tmp_path / "one", 2, "Suturing", 1, 8.0, "a test", 1)
    with pytest.raises(DataError, match="needs trials of at least two people"):
        find_trials(str(tmp_path / "one"), "Suturing", tmp_path, 1, 8.0)
