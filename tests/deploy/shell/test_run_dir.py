"""The run folder: whole files or none."""

import hashlib
import json
import math
import os
import shlex
import stat
import sys
from pathlib import Path

import pytest

from tests.deploy.report.hand_made import a_scenario
from tis.common.errors import DataError, InputError
from tis.common.runtime.process import command_line
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import unwritable


def _names(path: Path) -> list[str]:
    return sorted(item.name for item in path.iterdir())


def test_a_written_file_is_there_readable_for_all_and_alone(tmp_path: Path) -> None:
    folder.write(tmp_path / "a.json", "first")
    folder.write(tmp_path / "a.json", "second, µ")
    assert (tmp_path / "a.json").read_text(encoding="utf-8") == "second, µ"
    assert stat.S_IMODE((tmp_path / "a.json").stat().st_mode) == 0o644
    assert _names(tmp_path) == ["a.json"]


def test_a_write_that_fails_half_way_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.write(tmp_path / "a.json", "old")

    def no_space(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", no_space)
    with pytest.raises(DataError, match=r"a\.json: cannot be written: No space left on device"):
        folder.write(tmp_path / "a.json", "new")
    assert (tmp_path / "a.json").read_text() == "old"
    assert _names(tmp_path) == ["a.json"]


def test_text_that_cannot_be_encoded_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(UnicodeEncodeError):
        folder.write(tmp_path / "a.json", "half of a pair: \ud800")
    assert _names(tmp_path) == []


def test_a_folder_that_is_gone_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be written: No such file or directory"):
        folder.write(tmp_path / "gone" / "a.json", "x")


def test_json_without_a_value_for_json_is_refused_before_the_file_is_touched(tmp_path: Path) -> None:
    folder.write_json(tmp_path / "a.json", {"value": 1.5})
    with pytest.raises(ValueError, match="JSON"):
        folder.write_json(tmp_path / "a.json", {"value": math.nan})
    assert folder.read_json(tmp_path / "a.json") == {"value": 1.5}


def test_json_that_is_not_there_is_none_and_torn_json_is_one_line(tmp_path: Path) -> None:
    assert folder.read_json(tmp_path / "a.json") is None
    (tmp_path / "a.json").write_text('{"value": 1')
    with pytest.raises(DataError, match=r"a\.json: is not readable JSON"):
        folder.read_json(tmp_path / "a.json")


def test_a_run_folder_is_made_with_its_scenario_and_taken_back_unused(tmp_path: Path) -> None:
    scenario = a_scenario(seed=5)
    path = folder.create(tmp_path / "runs" / "one", scenario)
    assert folder.read_scenario(path) == scenario
    with pytest.raises(DataError, match="must be new or empty"):
        folder.create(path, scenario)
    folder.remove_unused(path)
    assert _names(tmp_path / "runs") == []


def test_a_folders_own_scenario_counts_before_one_from_elsewhere(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no run folder"):
        folder.read_scenario(tmp_path)
    folder.create(tmp_path / "run", a_scenario(seed=5))
    elsewhere = (tmp_path / "run" / "scenario.yaml").read_text().replace("seed: 5", "seed: 6")
    assert folder.read_scenario(tmp_path, elsewhere).seed == 6
    assert folder.read_scenario(tmp_path / "run", elsewhere).seed == 5
    (tmp_path / "run" / "scenario.yaml").write_text("fnord: 1\n")
    with pytest.raises(InputError, match="fnord: unknown key"):
        folder.read_scenario(tmp_path / "run")


def test_a_run_of_an_earlier_version_is_read_in_the_words_of_this_one(tmp_path: Path) -> None:
    path = folder.create(tmp_path / "run", a_scenario(estimators=("hold", "moesp_kf"), active_estimator="moesp_kf"))
    file = path / "scenario.yaml"
    file.write_text(file.read_text().replace("moesp_kf", "velocity"))
    found = folder.read_scenario(path)
    assert found.active_estimator == found.estimators[1] == "tis.patient_side.estimators:velocity"


def test_the_manifest_names_every_file_by_its_hash_but_not_itself(tmp_path: Path) -> None:
    (tmp_path / "patient.mcap").write_bytes(b"abc")
    (tmp_path / "manifest.json").write_text("{}")
    kept = {"boot_id": "b", "discipline": {"synchronised": True, "maximum_error_us": 31}}
    found = folder.manifest(tmp_path, "tis run default", "live", {"surgeon": 0, "netem": -9}, {"surgeon": kept})
    assert found["clocks"] == {"surgeon": kept}
    assert found["sha256"] == {"patient.mcap": hashlib.sha256(b"abc").hexdigest()}
    assert found["exit_codes"] == {"surgeon": 0, "netem": -9}
    assert found["python"] == ".".join(str(part) for part in sys.version_info[:3])
    assert found["versions"]["eclipse-zenoh"]
    assert found["host"]["cpus"] == os.cpu_count()
    json.dumps(found, allow_nan=False)


def test_the_command_can_be_typed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["run", "my scenario.yaml", "--set", "source.hands=[left, right]", "--seed", "3"]
    monkeypatch.setattr(sys, "argv", ["/somewhere/bin/tis", *words])
    assert shlex.split(command_line()) == ["tis", *words]


@pytest.mark.parametrize("word", ["it's", "back\\slash", "", "two\nlines", "#hash", "~home"])
def test_awkward_words_survive_the_shell(monkeypatch: pytest.MonkeyPatch, word: str) -> None:
    monkeypatch.setattr(sys, "argv", ["tis", "run", word])
    assert shlex.split(command_line()) == ["tis", "run", word]


def test_a_page_lies_below_a_folder_that_writing_makes_unless_a_file_is_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = folder.page_file("paper.md")
    assert page == Path("runs/paper.md")
    assert unwritable(page) == []
    assert not (tmp_path / "runs").exists()  # a refusal leaves none
    folder.write(page, "text")
    assert page.read_text() == "text"
    page.unlink()
    (tmp_path / "runs").rmdir()
    (tmp_path / "runs").write_text("a file")
    assert unwritable(page) != []
    with pytest.raises(DataError, match="runs: folder cannot be created: File exists"):
        folder.write(page, "text")
