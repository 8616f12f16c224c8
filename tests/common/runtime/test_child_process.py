"""A child process imports the packages that run here, whatever its folder and the user's own PYTHONPATH."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import common
from common.runtime.child_process import child_environment


def test_a_child_in_another_folder_imports_the_same_packages(tmp_path: Path) -> None:
    printed = subprocess.run(
        [sys.executable, "-c", "import common; print(common.__file__)"],
        cwd=tmp_path, env=child_environment(), capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert Path(printed.stdout.strip()).samefile(common.__file__)


@pytest.mark.parametrize("words", [("-m", "common"), ("-c", "import common; print(common.__file__)")])
def test_a_package_of_the_same_name_in_the_current_folder_is_not_imported(
    tmp_path: Path, words: tuple[str, ...]
) -> None:
    (tmp_path / "common").mkdir()
    (tmp_path / "common" / "__init__.py").write_text("raise ImportError('not the testbed')\n")
    done = subprocess.run(
        [sys.executable, *words], cwd=tmp_path, env=child_environment(), capture_output=True, text=True, check=False
    )
    assert "not the testbed" not in done.stderr


def test_the_users_own_path_stays_behind_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/somewhere/else")
    first, *others = child_environment()["PYTHONPATH"].split(os.pathsep)
    assert (Path(first) / "common").samefile(Path(common.__file__).parent)
    assert others == ["/somewhere/else"]
