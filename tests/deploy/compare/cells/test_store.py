"""Files of a store: what is damaged or foreign counts as missing, so that it is computed again."""

from pathlib import Path
from typing import Any

import pytest

from tis.common.errors import DataError
from tis.deploy.compare.cells.store import Store

CELL = {"trial": "S001", "hands": {}}
TRAINING: dict[str, Any] = {"train_s": {}, "warnings": []}


def test_what_was_stored_is_found(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.cell("a") is None
    assert store.training("b") is None
    store.save_cell("a", CELL)
    store.save_training("b", TRAINING, b"{models}")
    assert store.cell("a") == CELL
    assert (store.training("b") or {}).items() >= TRAINING.items()
    assert store.model_file("b").read_bytes() == b"{models}"


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"trial": "S001"}', "null", "[" * 100_000])
def test_a_damaged_result_is_missing(tmp_path: Path, content: str) -> None:
    store = Store(tmp_path)
    store.save_cell("a", CELL)
    store.save_training("b", TRAINING, b"{models}")
    (tmp_path / "cells" / "a.json").write_text(content)
    (tmp_path / "trainings" / "b.json").write_text(content)
    assert store.cell("a") is None
    assert store.training("b") is None


def test_models_that_were_changed_or_cut_are_missing(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for content in ("mod", "models!", None):
        store.save_training("b", TRAINING, b"{models}")
        assert store.training("b") is not None
        file = store.model_file("b")
        file.unlink() if content is None else file.write_text(content)
        assert store.training("b") is None


def test_a_store_makes_its_folder_with_the_first_result(tmp_path: Path) -> None:
    store = Store(tmp_path / "runs" / "mine")
    assert store.cell("a") is None
    assert list(tmp_path.iterdir()) == []
    store.save_cell("a", CELL)
    assert store.cell("a") == CELL


def test_a_folder_that_cannot_be_made_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="folder cannot be created"):
        Store(tmp_path / "file" / "mine")
