"""Measure a region on recorded trials: its area against a dense grid's, and places inside on fresh seeds.

``python -m tests.deploy.studies.admissible.bench_region ESTIMATOR LARGEST_DELAY_MS [N_GRID] [N_FRESH]``: the region
of networks with delay and loss in which the error is at most 2 mm, for 30 s of one trial of each person below
TIS_JIGSAWS and four seeds; a grid of N_GRID x N_GRID networks (15) by the same criterion; N_FRESH places inside (40),
judged on 20 seeds that the search did not have. Takes some ten minutes on two cores.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from tis.common.runtime.recordings import list_trials
from tis.common.scenario.source import JigsawsSource
from tis.common.streams import Stream
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.workers import Processes
from tis.deploy.compare.plan import Request
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.admissible.border import find_border
from tis.deploy.studies.admissible.command import order_of
from tis.deploy.studies.admissible.evaluation import Evaluation, Judged
from tis.deploy.studies.admissible.region import Place
from tis.deploy.studies.admissible.study import Order

_SEEDS, _FRESH_SEEDS = 4, 20
_MANY = 20_000


def main(estimator: str, largest_ms: float, n_grid: int = 15, n_fresh: int = 40) -> None:
    order, out = _order(estimator, largest_ms), Console(soft_wrap=True)
    with tempfile.TemporaryDirectory() as folder, Processes() as workers:
        evaluation = Evaluation(
            (estimator,), order.limits, Store(Path(folder)), workers, PhaseProgress(Console(stderr=True))
        )

        def judged(request: Request, places: list[Place]) -> list[Judged]:
            networks = [
                {axis.path: axis.text(share) for axis, share in zip(order.axes, place, strict=True)}
                for place in places
            ]
            return evaluation.judge(request, networks)

        def margins(request: Request, places: list[Place]) -> list[float]:
            return [one.margins[estimator] for one in judged(request, places)]

        tolerance, most, _ = order.effort
        border = find_border(
            lambda places: [[margin] for margin in margins(order.request, list(places))], 2, 1, tolerance, most
        )
        (region,) = border.regions
        counts = f"{evaluation.n_networks} networks, {border.n_open[0]} rays open"
        out.print(f"{estimator}: {counts}, {100 * region.share:.1f} %")

        steps = [(i + 0.5) / n_grid for i in range(n_grid)]
        grid: list[Place] = [(x, y) for x in steps for y in steps]
        share = sum(margin <= 0 for margin in margins(order.request, grid)) / len(grid)
        ratio = region.share / share
        out.print(f"grid of {n_grid} x {n_grid}: {100 * share:.1f} %, area of the region {ratio:.3f} of it")

        drawn = Stream.named(1, "bench/region").uniforms(0, 2 * _MANY).reshape(-1, 2).tolist()
        inside: list[Place] = [tuple(place) for place in drawn if region.contains(place)][:n_fresh]
        fresh = replace(order.request, seed=order.fresh_seed, n_seeds=_FRESH_SEEDS)
        bounds = [one.bounds[estimator][0] for one in judged(fresh, inside)]
        above = sum(bound > order.limits[0].value for bound in bounds)
        found = f"{above} bounds above the limit, largest {max(bounds):.3f}"
        out.print(f"of {len(bounds)} places inside, on fresh seeds: {found}")


def _order(estimator: str, largest_ms: float) -> Order:
    trials = {name[0]: name for name in list_trials(JigsawsSource(kind="jigsaws", task="Suturing"))}
    given = {
        "scenario": "default",
        "limits": ["rmse_3d_mm=2"],
        "over": [f"network.forward.delay.delay_ms=0..{largest_ms:g}", "network.forward.loss.p_loss=0..0.3"],
        "estimators": f"hold,{estimator}",
        "trials": ",".join(trials.values()),
        "people": None,
        "n_seeds": _SEEDS,
        "settings": ["source={kind: jigsaws, task: Suturing, hands: [left]}"],
        "seed": None,
        "duration_s": 30.0,
        "profiles": "none",
        "max_copies": 4,
        "n_checks": 0,
        "cheapest_by": "bytes",
        "tolerance": 0.02,
        "max_points": 100,
    }
    return order_of(given)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), *map(int, sys.argv[3:]))
