"""Whether a file can be written, asked beforehand: the oracle is writing it."""

from pathlib import Path

import pytest

from tis.common.errors import DataError, Fault
from tis.deploy.shell.guard import check_outputs, unwritable
from tis.deploy.shell.run_dir import write


def test_it_is_refused_beforehand_as_it_would_be_in_the_end(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    for name in ("new.json", "file", "absent/a.json", "file/a.json", "folder", "folder/a.json"):
        path = tmp_path / name
        before = sorted(tmp_path.rglob("*"))
        found = unwritable(path)
        assert sorted(tmp_path.rglob("*")) == before
        assert found == _written(path), name


def _written(path: Path) -> list[Fault]:
    try:
        write(path, "content")
    except DataError as error:
        return list(error.faults)
    return []


def test_all_are_named_and_options_that_were_not_given_do_not_count(tmp_path: Path) -> None:
    check_outputs(None, tmp_path / "a.json")
    with pytest.raises(DataError) as caught:
        check_outputs(tmp_path / "x" / "a", None, tmp_path / "y" / "b", tmp_path / "c")
    assert len(caught.value.faults) == 2
