"""The keys of summary.json that only live runs have: what the strict build, which reads a twin's, cannot see."""

import pytest

from from_code.summary_keys import types_of, undescribed, words
from tests.system.conftest import Start, model_file, start

__all__ = ["model_file", "start"]


@pytest.mark.live
def test_every_key_of_a_live_run_is_explained(start: Start) -> None:
    tis = start("run", "default", "--duration-s", "4", "--set", "source.hands=[left,right]", identified=True)
    tis.wait()
    found = types_of(tis.summary())
    assert undescribed(found) == set()
    live = {path for path, text in words().items() if text.startswith(("[live]", "[two hands]"))}
    assert live - found.keys() == set()
