"""A short, always equal part of the campaign on whole sides."""

import pytest

from tests.fuzz.whole_sides import DOORS, fuzz, table

EPISODES = {"patient": 4, "surgeon": 5, "control": 8}
N_STEPS, N_USED = 300, 100


@pytest.mark.parametrize("door", DOORS)
def test_no_message_raises_and_honest_ones_in_between_are_used(door: str) -> None:
    tally = fuzz(door, 0, lambda so_far: so_far.n_episodes >= EPISODES[door], quick=True)
    assert not tally.exits, table([tally])
    assert tally.n_steps >= N_STEPS
    assert tally.n_used >= N_USED
