"""Of five networks, where further records lie: ``python -m tests.netem.fit.bench_prediction FIRST LAST``.

Prints what holds fewer than 34 of them, for the seeds from FIRST to LAST. ``limit`` instead prints what is within
reach: intervals about each record whose width comes from the true spread, which no fit of one record knows.
"""

import sys

import numpy as np

from tests.netem.fit.synthetic_records import record
from tests.netem.fit.test_prediction import N_FURTHER, OF, TRUTHS, inside
from tis.netem.draws.blocks import Floats
from tis.netem.fit.prediction import interval, scaled
from tis.netem.fit.statistics import NAMES, statistics_of

LEAST = 34 / 40
N_SETS, N_KNOWN = 300, 300
WIDTHS = (2.77, 3.29, 3.64, 4.0, 4.6)


def judge(seeds: range) -> None:
    """Print for each seed what does not hold, and the share that lies inside."""
    pooled, n_good = [], 0
    for seed in seeds:
        few = []
        for truth in TRUTHS:
            for name, [(share, closes)] in inside(truth, OF, range(seed, seed + 1), N_FURTHER).items():
                pooled.append(share)
                if closes and share < LEAST:
                    few.append(f"{truth}: {name}: {share:.3g}")
        n_good += not few
        print(seed, "; ".join(few) or "holds", flush=True)  # noqa: T201
    print(f"{n_good} of {len(seeds)} sets hold, pooled {np.mean(pooled):.4f}")  # noqa: T201


def limit() -> None:
    """Print the share inside and the sets that hold, for half-widths in standard deviations of a record."""
    values = {truth: _values(truth) for truth in TRUTHS}
    for width in WIDTHS:
        pooled, holds = [], np.ones(N_SETS, dtype=bool)
        for of in values.values():
            for name, column in zip(NAMES, of.T, strict=True):
                spread = float(scaled(name, column).std())
                if np.isnan(spread) or spread == 0:
                    continue
                for number in range(N_SETS):
                    low, high = interval(name, float(column[number]), width * spread)
                    further = column[N_SETS : N_SETS + N_FURTHER]
                    pooled.append(float(np.mean((further >= low) & (further <= high))))
                    holds[number] &= pooled[-1] >= LEAST
        print(f"{width:g}: pooled {np.mean(pooled):.4f}, {np.mean(holds):.0%} of sets hold", flush=True)  # noqa: T201


def _values(truth: str) -> Floats:
    made = (record(truth, OF, seed) for seed in range(3000, 3000 + N_SETS + N_KNOWN))
    return np.array([statistics_of(one.sent_ns, one.delay_ns) for one in made])


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["limit"]:
            limit()
        case [first, last]:
            judge(range(int(first), int(last) + 1))
