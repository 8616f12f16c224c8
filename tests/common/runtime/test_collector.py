"""The collector is as it was before, once the block is over."""

import gc

import pytest

from common.runtime.collector import without_collector


@pytest.mark.parametrize("was_on", [True, False])
def test_it_is_off_within_and_as_before_afterwards(was_on: bool) -> None:
    before = gc.isenabled()
    try:
        (gc.enable if was_on else gc.disable)()
        with without_collector():
            within = gc.isenabled()
        assert not within
        assert gc.isenabled() == was_on
        with pytest.raises(ZeroDivisionError), without_collector():
            raise ZeroDivisionError
        assert gc.isenabled() == was_on
    finally:
        (gc.enable if before else gc.disable)()
