"""Stability region over delay and stiffness: of each coupling the stiffest wall whose twin is stable, by bisection.

All couplings and delays advance together: a step is one plan of twins, and all processors work. A twin counts as
stable by the verdict of its summary; one that is not decidable does not.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import exp, log
from typing import Any, Final, NamedTuple

from tis.common.errors import Fault, InputError
from tis.common.scenario import Scenario
from tis.deploy.compare.cells.identity import summarised
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.compute import compute
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.compare.grid import Sweep
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.run.resolve import resolve
from tis.deploy.shell.progress import PhaseProgress

COMMAND: Final = "tis touch"
_WALL: Final = "touch.environment.stiffness_n_m"
_DELAYS: Final = tuple(f"network.{way}.delay.delay_ms" for way in ("forward", "feedback"))


class Loop(NamedTuple):
    """A coupling with the estimator that drives the arm, which only ``position_force`` follows."""

    coupling: str
    estimator: str

    @property
    def name(self) -> str:
        """The loop in words."""
        return f"position_force, {self.estimator}" if self.coupling == "position_force" else self.coupling


class Twin(NamedTuple):
    """What a twin told; ``stable`` is None where it was not decidable, ``limit_n_m`` where theory is silent."""

    loop: Loop
    delay_ms: float
    stiffness_n_m: float
    stable: bool | None
    limit_n_m: float | None
    energy_mj: float | None
    shown_over_true: float | None


class Border(NamedTuple):
    """Of a loop at a delay each way: the stiffest stable wall and the least one above it that is not stable, in N/m.

    None: none of the walls that were tried is stable, or all are.
    """

    loop: Loop
    delay_ms: float
    stable_n_m: float | None
    not_stable_n_m: float | None
    limit_n_m: float | None


Run = Callable[[Sequence[tuple[Loop, float, float]]], list[Twin]]


def loops_of(couplings: Sequence[str], estimators: Sequence[str]) -> list[Loop]:
    """Return the loops: a passive coupling follows no estimator, so it is one."""
    return [
        Loop(coupling, name)
        for coupling in couplings
        for name in (estimators if coupling == "position_force" else estimators[:1])
    ]


def find_borders(
    loops: Sequence[Loop], delays_ms: Sequence[float], walls_n_m: tuple[float, float], n_steps: int, run: Run
) -> tuple[list[Border], list[Twin]]:
    """Return the border of each loop at each delay, and all twins, of which there are at most ``2 + n_steps`` each.

    The stiffest wall comes first, as a passive coupling stands it; then the softest one, then the geometric mean of
    the bracket. Oracle: loops of known limits, test_study.
    """
    soft, hard = walls_n_m
    brackets: dict[tuple[Loop, float], list[float | None]] = {
        (loop, ms): [None, None] for loop in loops for ms in delays_ms
    }
    twins: list[Twin] = []
    for step in range(2 + n_steps):
        asked = []
        for (loop, ms), (low, high) in brackets.items():
            if step == 0:
                asked.append((loop, ms, hard))
            elif step == 1 and high is not None:
                asked.append((loop, ms, soft))
            elif step > 1 and low is not None and high is not None:
                asked.append((loop, ms, exp(0.5 * (log(low) + log(high)))))
        found = run(asked) if asked else []
        twins += found
        for twin in found:
            brackets[twin.loop, twin.delay_ms][0 if twin.stable else 1] = twin.stiffness_n_m
    # the round trip hardly hangs on the wall: any twin tells theory's limit
    limits = {(twin.loop, twin.delay_ms): twin.limit_n_m for twin in twins}
    return [
        Border(*place, low, high, limits.get(place)) for place, (low, high) in brackets.items()
    ], twins  # fmt: skip


def twins_by(request: Request, store: Store, workers: Workers, progress: PhaseProgress) -> Run:
    """Return what computes twins of the request's scenario, or reads them from the store."""
    hand = checked(request).source.hands[0]

    def run(asked: Sequence[tuple[Loop, float, float]]) -> list[Twin]:
        columns: dict[str, list[str]] = {
            "touch.coupling": [loop.coupling for loop, _, _ in asked],
            "active_estimator": [loop.estimator for loop, _, _ in asked],
            **{path: [f"{ms:g}" for _, ms, _ in asked] for path in _DELAYS},
            _WALL: [f"{wall:.4g}" for _, _, wall in asked],
        }
        sweeps = tuple(Sweep(path, tuple(values)) for path, values in columns.items())
        plan = make_plan(_swept(request, sweeps))
        cells = [summarised(cell) for cell in plan.cells]
        outcome = compute(cells, plan.trainings, store, workers, progress)
        outcome.check()
        found = (outcome.cells[cell.digest]["summary"] for cell in cells)
        return [_twin(one, summary, f"touch.{hand}") for one, summary in zip(asked, found, strict=True)]

    return run


def _swept(request: Request, sweeps: tuple[Sweep, ...]) -> Request:
    return replace(request, sweeps=sweeps, zipped=True, n_seeds=1)


def checked(request: Request) -> Scenario:
    """Return the scenario; raises `InputError` unless it touches a wall through constant delays."""
    scenario = resolve(request.scenario, request.settings, request.seed, request.duration_s)
    if scenario.touch is None or scenario.touch.environment.kind != "wall":
        rule = "must touch a wall, as `touch` does: its stiffness is what varies"
        raise InputError(Fault(COMMAND, "scenario", rule, request.scenario))
    return scenario


def _twin(asked: tuple[Loop, float, float], summary: Mapping[str, Any], where: str) -> Twin:
    stable = summary.get(f"{where}.stable")
    names = ("limit_n_m", "energy_mj", "shown_over_true")
    return Twin(*asked, None if stable is None else bool(stable), *(summary.get(f"{where}.{name}") for name in names))
