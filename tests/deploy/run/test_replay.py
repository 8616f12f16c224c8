"""What a replay comes to, in words: a difference and a lack are not the same."""

import pytest

from deploy.run.replay import Comparison

_PART = "the readable part is identical, bit for bit, but the log does not hold the whole run"


@pytest.mark.parametrize(
    ("found", "words", "identical"),
    [
        (Comparison(10, 0, 0), "identical, bit for bit", True),
        (Comparison(10, 1, 0), "not identical", False),
        (Comparison(10, 0, 1), "not identical", False),
        (Comparison(10, 0, 0, "torn"), _PART, False),
        (Comparison(10, 0, 3, "torn"), _PART, False),
        (Comparison(10, 2, 0, "torn"), "not identical", False),
        (Comparison(0, 0, 0), "nothing to compare", False),
    ],
)
def test_each_outcome_has_its_words(found: Comparison, words: str, identical: bool) -> None:
    assert str(found).endswith(f"are in one only: {words}")
    assert found.identical is identical
