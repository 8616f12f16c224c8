"""Fixtures that every part of the tests shares."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples on every machine, and no deadline on a busy one.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

_ROOT = Path(__file__).resolve().parents[1]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let one worker run all live tests, one after the other: beside each other they would disturb each other."""
    for item in items:
        if item.get_closest_marker("live") is not None:
            item.add_marker(pytest.mark.xdist_group("live"))


@pytest.fixture(scope="session")
def jigsaws_dir() -> Path:
    """Return the folder of real trials; skips where there is none, as the data set may not be redistributed."""
    path = Path(os.environ.get("TIS_JIGSAWS", _ROOT.parent / "shared" / "data" / "jigsaws"))
    if not path.is_dir():
        pytest.skip("no JIGSAWS trials here: set TIS_JIGSAWS to the folder that holds Suturing/, ...")
    return path
