"""The score over all settings: a geometric mean, and an interval of the same people in all of them."""

import numpy as np
import pytest

from tis.common.streams import Stream
from tis.deploy.compare.results.pooled import SEED
from tis.deploy.studies.score.rows import overall


def _hand(own: float, hold: float) -> dict[str, object]:
    def entry(sse: float) -> dict[str, object]:
        return {"sse_m2": [sse, 0.0, 0.0], "n_missing": 0}

    return {
        "n_scored": 10,
        "sst_m2": [1.0, 1.0, 1.0],
        "range_m": [1.0, 1.0, 1.0],
        "estimators": {"hold": entry(hold), "mine": entry(own)},
    }


def test_the_score_is_the_geometric_mean_and_its_interval_that_of_a_loop_over_resamples() -> None:
    sums = {"near": [(1.0, 4.0), (2.0, 4.0), (1.0, 9.0)], "far": [(5.0, 6.0), (3.0, 9.0), (8.0, 8.0)]}
    settings = {name: {str(i): [_hand(*pair)] for i, pair in enumerate(people)} for name, people in sums.items()}
    found, bounds = overall(settings, "mine")
    assert found == pytest.approx(((4 / 17) ** 0.5 * (16 / 23) ** 0.5) ** 0.5, abs=5e-4)
    uniforms = Stream.named(SEED, "compare/bootstrap").uniforms(0, 2000 * 3)
    scores = []
    for k in range(2000):
        people = [int(u * 3) for u in uniforms[3 * k : 3 * k + 3]]
        ratios = [
            (sum(pairs[p][0] for p in people) / sum(pairs[p][1] for p in people)) ** 0.5 for pairs in sums.values()
        ]
        scores.append((ratios[0] * ratios[1]) ** 0.5)
    assert bounds == pytest.approx(list(np.percentile(scores, [2.5, 97.5])), abs=6e-4)
