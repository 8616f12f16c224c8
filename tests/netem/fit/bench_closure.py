"""Fit and replay of synthetic records: ``python -m tests.netem.fit.bench_closure [SEED ...]``.

Prints each record with the structure taken, and what does not close. Parameters vary with the seed, so that nothing
is tuned to one set.
"""

import sys

import numpy as np

from tests.netem.fit.synthetic_records import RECORDS, Parameters, record
from tis.netem.fit.candidates import fit_closing
from tis.netem.fit.direction import DirectionFit
from tis.netem.fit.record import DirectionRecord


def parameters_of(seed: int) -> Parameters:
    """Return the process of a seed; seed 1 is the default one."""
    if seed == 1:
        return Parameters()
    rng = np.random.default_rng([seed, 7])

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    return Parameters(
        rate_hz=float(rng.choice([50, 100, 200])),
        shift=between(5, 60),
        mean=(mean := between(4, 20)),
        sd=mean * between(0.3, 0.8),
        half_life=between(0.05, 1.0),
        p_loss=between(0.005, 0.03),
        burst=between(2, 8),
        gap=between(20, 60),
        outage=between(0.5, 2.5),
        good=between(8, 25),
        bad=between(1, 4),
        p_bad=between(0.4, 0.6),
        bad_delay=float(rng.choice([0.0, 0.5, 2.0])) * mean,
        stall=between(0.15, 0.5),
        stall_spread=float(rng.choice([0.0, 0.3, 0.6])),
    )


def structure(fit: DirectionFit) -> str:
    """Return what was fitted, in words."""
    loss = fit.stages.get("loss", {}).get("kind", "no loss")
    outages = "" if fit.outages.process is None else f", {len(fit.outages.lengths_s)} outages"
    outages += "" if fit.stalls is None else f", {len(fit.stalls.lengths_s)} stalls"
    outages += "" if fit.backlogs is None else f", {fit.backlogs.n} backlogs"
    outages += "" if fit.steps is None else f", {len(fit.steps.values_ms)} steps"
    return f"{loss}{outages}" + ("" if fit.states is None else f", {fit.states.note}")


def main(seeds: list[int]) -> int:
    """Fit and replay the four records of each seed; return how many sets need more than one warning record."""
    bad_sets = 0
    for seed in seeds:
        n_warned = 0
        for name in RECORDS:
            fit = fit_closing(DirectionRecord.of(record(name, parameters_of(seed), seed)))
            missed = [one for one in fit.closures if not one.closes]
            n_warned += bool(missed)
            words = "; ".join(f"{one.name} {one.record:.4g}, {one.low:.4g} to {one.high:.4g}" for one in missed)
            verdict = f"WARNS: {words}" if missed else "closes"
            print(f"{seed:3d} {name:10s} {verdict} ({structure(fit)})", flush=True)  # noqa: T201
        bad_sets += n_warned > 1
    print(f"{bad_sets} of {len(seeds)} sets need more than one warning")  # noqa: T201
    return int(bad_sets > 0)


if __name__ == "__main__":
    sys.exit(main([int(word) for word in sys.argv[1:]] or [1, 2, 3, 4, 5]))
