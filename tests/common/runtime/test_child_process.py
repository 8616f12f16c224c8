"""A child process imports the package that runs here, and the user's own packages under their names."""

import subprocess
import sys
from pathlib import Path

import pytest

import tis
from tis.common.runtime.process import child_environment

NAMES = ("common", "surgeon_side", "netem", "patient_side", "deploy")


def said(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=child_environment(), capture_output=True, text=True, check=False
    )


def test_a_child_in_another_folder_imports_the_same_package(tmp_path: Path) -> None:
    printed = said(tmp_path, "-c", "import tis; print(tis.__file__)").stdout.strip()
    assert Path(printed).samefile(tis.__file__)


@pytest.mark.parametrize("words", [("-m", "tis.common"), ("-c", "import tis.common")])
def test_a_package_of_the_same_name_in_the_current_folder_is_not_imported(
    tmp_path: Path, words: tuple[str, ...]
) -> None:
    (tmp_path / "tis").mkdir()
    (tmp_path / "tis" / "__init__.py").write_text("raise ImportError('not the testbed')\n")
    assert "not the testbed" not in said(tmp_path, *words).stderr


@pytest.mark.parametrize("name", NAMES)
def test_the_users_package_of_a_common_name_is_imported_by_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text("print('own')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert said(tmp_path, "-c", f"import tis.{name}, {name}").stdout == "own\n"


@pytest.mark.parametrize("name", NAMES)
def test_an_old_name_is_refused_with_the_new_one(name: str) -> None:
    root = Path(tis.__file__).parents[1]
    done = said(root, "-c", f"import sys; sys.path.insert(0, '.'); import {name}")
    assert done.returncode == 1
    assert f"{name} has become tis.{name}" in done.stderr
