"""The keys of summary.json that only live runs have: what the strict build, which reads a twin's, cannot see."""

import pytest

from from_code.summary_keys import types_of, undescribed, words
from tests.system.conftest import StartHere, model_file, run_here

__all__ = ["model_file", "run_here"]


@pytest.mark.live
def test_every_key_of_a_live_run_is_explained(run_here: StartHere) -> None:
    small = "identification={order: 2, block_rows: 3, train_samples: 240}"
    least = ("source.hands=[left,right]", "estimators=[hold,innovations_kf]", small)  # what takes least time
    settings = [word for text in least for word in ("--set", text)]
    tis = run_here("run", "default", "--duration-s", "4", *settings, identified=True)
    found = types_of(tis.summary())
    assert undescribed(found) == set()
    live = {path for path, text in words().items() if text.startswith(("[live]", "[two hands]"))}
    assert live - found.keys() == set()
