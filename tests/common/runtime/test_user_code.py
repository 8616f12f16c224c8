"""Where a user's code came from, as it is written down, and what is said when it is not what it was."""

import hashlib
import importlib
import sys
from pathlib import Path

import pytest

from tis.common.errors import DataError, InputError
from tis.common.runtime.process import PACKAGES
from tis.common.runtime.user_code import Origin, dump_origins, load_user_code, parse_origins


def test_changes_are_told_and_origins_read_back_as_they_were(own_folder: Path) -> None:
    (own_folder / "later_own.py").write_text("class F: pass\n")
    own = load_user_code(("later_own:F",), "estimators")
    origins = {name: code.origin for name, code in own.items()}
    assert parse_origins(dump_origins(origins), "x") == origins
    before = Origin("f.py", "1", {"g.py": "1", "h.py": "1"}, "lab", "1.0")
    assert before.changes(before) == ()
    assert Origin("f.py", "2", {"g.py": "2", "i.py": "1"}, "lab", "1.1").changes(before) == (
        "f.py has changed",
        "g.py, beside it, has changed",
        "h.py, beside it, has changed",
        "i.py, beside it, has changed",
        "lab was 1.0, and is 1.1 now",
    )
    assert Origin("e.py", "1", before.beside, "lab", "1.0").changes(before) == ("it came from f.py, and is e.py now",)


@pytest.mark.parametrize("data", [b"{", b"[]", b'{"a:b": {"file": 1}}', b'{"a:b": 3}'])
def test_a_damaged_note_of_origins_is_a_fault(data: bytes) -> None:
    with pytest.raises(DataError, match=r"patient\.mcap: estimators\.json: cannot be read"):
        parse_origins(data, "patient.mcap")


def test_linked_modules_lie_beside_those_of_the_folder_that_the_links_name(own_folder: Path) -> None:
    lab = own_folder / "lab"
    lab.mkdir()
    (lab / "beside_linked.py").write_text("x = 1\n")
    (lab / "own_linked.py").write_text("import beside_linked, beside_here\nclass F: pass\n")
    (own_folder / "beside_here.py").write_text("x = 1\n")
    for name in ("own_linked.py", "beside_linked.py"):
        (own_folder / name).symlink_to(lab / name)
    origin = load_user_code(("own_linked:F",), "estimators")["own_linked:F"].origin
    assert origin.file == "own_linked.py"
    assert list(origin.beside) == ["beside_linked.py"]


def write(path: Path, text: str) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return hashlib.sha256(text.encode()).hexdigest()


def faults(*names: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        load_user_code(names, "estimators")
    return [str(fault) for fault in caught.value.faults]


def test_nothing_asked_for_changes_nothing() -> None:
    before = list(sys.path)
    assert load_user_code((), "estimators") == {}
    assert sys.path == before


def test_the_current_folder_counts_and_what_lies_beside_is_known_too(own_folder: Path) -> None:
    sha256 = write(own_folder / "first_own.py", "import helper_own\nclass F:\n    class G: pass\n")
    beside = write(own_folder / "helper_own.py", "N = 1\n")
    write(own_folder / "never_imported_own.py", "N = 1\n")
    found = load_user_code(("first_own:F", "first_own:F.G"), "estimators")
    assert [code.factory.__qualname__ for code in found.values()] == ["F", "F.G"]
    origin = Origin("first_own.py", sha256, {"helper_own.py": beside})
    assert [code.origin for code in found.values()] == [origin, origin]
    assert sys.path.index(str(own_folder)) < sys.path.index(PACKAGES)  # a package `common` beside is the user's


def test_a_folder_below_is_named_before_its_module_without_being_a_package(own_folder: Path) -> None:
    write(own_folder / "below" / "own_below.py", "class F: pass\n")
    assert (
        load_user_code(("below.own_below:F",), "estimators")["below.own_below:F"].origin.file == "below/own_below.py"
    )


def test_of_a_package_the_defining_file_counts_and_the_rest_lies_beside(own_folder: Path) -> None:
    top = write(own_folder / "lab_own" / "__init__.py", "from lab_own.filters import F\n")
    sha256 = write(own_folder / "lab_own" / "filters.py", "class F: pass\n")
    write(own_folder / "other_own.py", "")
    (code,) = load_user_code(("lab_own:F",), "estimators").values()
    assert code.origin == Origin("lab_own/filters.py", sha256, {"lab_own/__init__.py": top})


def test_what_is_taken_from_elsewhere_is_known_by_the_module_that_was_named(own_folder: Path) -> None:
    sha256 = write(own_folder / "partial_own.py", "from functools import partial\nF = partial(dict, a=1)\nG = dict\n")
    found = load_user_code(("partial_own:F", "partial_own:G"), "estimators")
    assert {(code.origin.file, code.origin.sha256) for code in found.values()} == {("partial_own.py", sha256)}


def test_an_installed_distribution_has_its_version(own_folder: Path) -> None:
    (code,) = load_user_code(("filterpy.kalman:KalmanFilter",), "estimators").values()
    assert code.origin.distribution == "filterpy"
    assert code.origin.version is not None
    assert code.origin.file == "filterpy/kalman/kalman_filter.py"


@pytest.mark.parametrize("installed", [False, True])
def test_a_name_of_before_the_one_import_name_is_told_the_new_one(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch, installed: bool
) -> None:
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path != PACKAGES])
    if not installed:  # a checkout
        sys.path.append(PACKAGES)
    importlib.invalidate_caches()
    write(own_folder / "old_own.py", "from common.errors import Fault\n")
    (fault,) = faults("old_own:F")
    assert "has become" in fault
    assert "tis.common" in fault


def test_all_faults_come_at_once_a_line_each(own_folder: Path) -> None:
    write(own_folder / "broken_own.py", "\ndef f():\n    raise RuntimeError('no\\n licence')\nf()\n")
    write(own_folder / "syntax_own.py", "def x(:\n")
    write(own_folder / "needs_own.py", "import nothing_own\n")
    write(own_folder / "exits_own.py", "raise SystemExit(3)\n")
    write(own_folder / "there_own.py", "N = 3\nclass AlphaBeta: pass\n")
    names = ("nope_own:X", "broken_own:F", "syntax_own:F", "needs_own:F", "exits_own:F", "there_own:AlphaBet",
             "there_own:N", "there_own.deeper:F", "nope_own.deeper:F")  # fmt: skip
    nowhere = "neither in the current folder nor on Python's search path"
    assert faults(*names) == [
        f"estimators: nope_own:X: no module 'nope_own', {nowhere}",
        "estimators: broken_own:F: broken_own cannot be imported: RuntimeError: no licence (broken_own.py, line 3)",
        "estimators: syntax_own:F: syntax_own cannot be imported: SyntaxError: invalid syntax "
        "(syntax_own.py, line 1)",
        "estimators: needs_own:F: needs_own cannot be imported: ModuleNotFoundError: No module named 'nothing_own' "
        "(needs_own.py, line 1)",
        "estimators: exits_own:F: exits_own cannot be imported: SystemExit: 3 (exits_own.py, line 1)",
        "estimators: there_own:AlphaBet: there_own.py has no 'AlphaBet', did you mean 'AlphaBeta'?",
        "estimators: there_own:N: must be a class or a function that takes the arm's model; N is of type int",
        f"estimators: there_own.deeper:F: no module 'there_own.deeper', {nowhere}",
        f"estimators: nope_own.deeper:F: no package 'nope_own' of 'nope_own.deeper', {nowhere}",
    ]
