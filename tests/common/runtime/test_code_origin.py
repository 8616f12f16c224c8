"""Where a user's code came from, as it is written down, and what is said when it is not what it was."""

from pathlib import Path

import pytest

from tis.common.errors import DataError
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
