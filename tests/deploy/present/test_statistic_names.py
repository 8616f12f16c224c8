"""One word for each statistic."""

import pytest

from tis.deploy.present.numbers import heads, percentile_name, statistic_name


def test_the_summarys_names_become_words() -> None:
    assert [statistic_name(name) for name in ("mean", "std", "p50", "p95", "p99.9", "max")] == [
        "mean", "std", "median", "p95", "p99.9", "max",
    ]  # fmt: skip
    assert heads(("p50", "max"), "ms") == ("median, ms", "max, ms")
    assert heads(("p50", "max")) == ("median", "max")


@pytest.mark.parametrize(("percent", "word"), [(None, ""), (50.0, "median"), (99.0, "p99"), (99.9, "p99.9")])
def test_percentiles_have_words_too(percent: float | None, word: str) -> None:
    assert percentile_name(percent) == word
