"""Plans of the twins behind the table: for each method one plan for each measure, with trainings of its own."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from tis.common.estimators import scenario_name
from tis.common.scenario.estimator_names import is_learned
from tis.common.scenario.reading import build_scenario
from tis.deploy.compare.cells.cell import Cell, Training
from tis.deploy.compare.cells.identity import cell_of, dump, training_of, training_on
from tis.deploy.compare.grid import Point, Sweep, number_text
from tis.deploy.compare.plan import Plan, Request, make_plan
from tis.deploy.studies.methods.trials import DELAY_MS, MEAN_BURST, RELIABILITY_NETWORK, Extent, Trials

Measure = Literal["accuracy", "loss", "noise", "noise_trained", "reliability", "data", "size", "adaptability", "fast"]

HOLD: Final = "hold"
ALL: Final = "all"
OWN, OTHER_PERSON = "own person", "other person"
_AT_DELAY: Final = f"network={{forward: {{delay: {{kind: constant, delay_ms: {DELAY_MS:g}}}}}}}"
_FAST_ERROR: Final = ("surgeon.sensor_noise_mm=0.01", "identification.sensor_noise_mm=0.01")  # no sensor is without
_FAST: Final = ("rate_hz=1000", "patient.tick_phase_ms=0.5", *_FAST_ERROR)
_FAST_ROWS: Final = 6000
_FAST_LEARNED_ROWS: Final = 20000
"""Training rows at 1 kHz; learned methods judge forecasts of five seconds on the last third of theirs."""
_FAST_S: Final = 5.0
"""Length of the twin at 1 kHz, in s: 5000 steps of each hand."""
_N_ADAPTED: Final = 2
"""Trials of each training of `adaptability`: as many as the other tasks have, so that all learn from as much."""
_N_SIZED: Final = 4
"""Trials of each training of `size`."""


@dataclass(frozen=True)
class Subject:
    """What is measured: a method, on trials, to an extent, with a seed."""

    method: str
    trials: Trials
    extent: Extent
    seed: int

    @property
    def estimator(self) -> str:
        """The method's name in scenarios, and so in results of twins."""
        return scenario_name(self.method)


def plans_of(subject: Subject) -> dict[Measure, Plan]:
    """Return the plan of each measure; raises `InputError` and `DataError`.

    The training of the models is part of a plan; its label names the method. All twins have the estimators `hold` and
    the method's, so that the twins of one method never depend on another's.
    """
    extent = subject.extent
    delays = Sweep("network.forward.delay.delay_ms", tuple(number_text(each) for each in extent.delays_ms))
    sent = Sweep("surgeon.sensor_noise_mm", tuple(number_text(each) for each in extent.noises_mm))
    noises = extent.noises_mm  # learned methods, whose training takes minutes, are trained with two of them
    noisy = tuple(map(number_text, (noises[0], noises[-1]) if is_learned(subject.method) else noises))
    losses = Sweep("network.forward.loss", tuple(loss_text(*each) for each in losses_of(extent)))
    plans: dict[Measure, Plan] = {
        "accuracy": _accuracy(subject, delays),
        "loss": _planned(subject, (_AT_DELAY,), (losses,)),
        "noise": _planned(subject, (_AT_DELAY,), (sent,)),
        "noise_trained": _planned(
            subject,
            (_AT_DELAY,),
            (Sweep("surgeon.sensor_noise_mm", noisy), Sweep("identification.sensor_noise_mm", noisy)),
        ),
        "reliability": _planned(subject, (RELIABILITY_NETWORK,), n_seeds=extent.n_seeds),
        "data": _data(subject),
        "size": _size(subject),
        "adaptability": _adaptability(subject),
        "fast": _fast(subject),
    }
    return {measure: _named(plan, subject.method) for measure, plan in plans.items()}


def losses_of(extent: Extent) -> list[tuple[float, bool]]:
    """Return share in per cent, and whether it is lost in bursts, of each network of ``loss``."""
    return [(pct, bursts) for bursts in (False, True) for pct in extent.losses_pct if pct or not bursts]


def loss_text(pct: float, bursts: bool) -> str:
    """Return a loss model as a setting, YAML on one line."""
    p_loss = number_text(pct / 100)
    if bursts:
        return f"{{kind: burst, p_loss: {p_loss}, mean_burst: {MEAN_BURST:g}}}"
    return f"{{kind: bernoulli, p_loss: {p_loss}}}"


def merged(plans: Sequence[Plan]) -> Plan:
    """Return one plan with the units of all, each once."""
    trainings = {digest: training for plan in plans for digest, training in plan.trainings.items()}
    cells = {cell.digest: cell for plan in plans for cell in plan.cells}
    return replace(plans[0], trainings=trainings, cells=tuple(cells.values()))


def _planned(
    subject: Subject,
    settings: tuple[str, ...],
    sweeps: tuple[Sweep, ...] = (),
    n_seeds: int = 1,
    trials: tuple[str, ...] | None = None,
) -> Plan:
    """Return the plan on the last trial of each person, or on ``trials``; several sweeps vary together."""
    place = subject.trials
    folder = "" if place.path is None else f", path: {json.dumps(place.path)}"
    source = f"source={{kind: jigsaws, task: {place.task}, hands: [left, right]{folder}}}"
    request = Request(
        "default",
        (source, *settings),
        tuple(dict.fromkeys((HOLD, subject.estimator))),
        trials or place.few(subject.extent.n_people),
        n_seeds=n_seeds,
        seed=subject.seed,
        duration_s=subject.extent.duration_s,
        sweeps=sweeps,
        zipped=len(sweeps) > 1,
    )
    return make_plan(request)


def _accuracy(subject: Subject, delays: Sweep) -> Plan:
    """Return the plan on all trials; a learned method, which draws random numbers, is trained with each seed."""
    extent = subject.extent
    trials = subject.trials.names if extent.n_people is None else subject.trials.few(extent.n_people)
    if not is_learned(subject.method):
        return _planned(subject, (_AT_DELAY,), (delays,), trials=trials)
    plans = [
        _planned(subject, (_AT_DELAY, f"identification.learning.seed={1 + i}"), (delays,), trials=trials)
        for i in range(extent.n_seeds)
    ]
    return merged(plans)


def _data(subject: Subject) -> Plan:
    """Return the plan with models of a growing number of trials of other people, last of all of them."""
    base = _planned(subject, (_AT_DELAY,))
    found = []
    for n in subject.extent.n_training_trials:
        for cell in base.cells:
            names = subject.trials.others(cell.trial)
            if n < len(names):
                label = f"{n} trials of subjects but {cell.trial[0]}"
                found.append((str(n), cell, training_on(_training(base, cell), names[:n], label)))
    found += [(ALL, cell, _training(base, cell)) for cell in base.cells]
    return _retrained(base, found, "training trials")


def _size(subject: Subject) -> Plan:
    """Return the plan with models of growing size for one trial; the order of the arm's model grows with the rows."""
    trial = subject.trials.few(subject.extent.n_people)[:1]
    found = []
    for n in subject.extent.block_rows:
        size = (f"identification.block_rows={n}", f"identification.order={n}")
        plan = _planned(subject, (_AT_DELAY, *size), trials=trial)
        for cell in plan.cells:
            names = subject.trials.others(cell.trial)[:_N_SIZED]
            found.append((str(n), cell, training_on(_training(plan, cell), names, f"{n} block rows")))
    return _retrained(plan, found, "block rows")


def _adaptability(subject: Subject) -> Plan:
    """Return the plan with models of the same person, of another one, and of another task."""
    base, trials = _planned(subject, (_AT_DELAY,)), subject.trials
    found = []
    for cell in base.cells:
        own, other = trials.own(cell.trial), trials.next_person(cell.trial)
        if not own:
            continue
        n = min(_N_ADAPTED, len(own), len(other))
        for label, names in ((OWN, own[:n]), (OTHER_PERSON, other[:n])):
            found.append((label, cell, training_on(_training(base, cell), names, f"{label} of {cell.trial}")))
        for task, elsewhere in trials.elsewhere.items():
            training = _of_task(cell, task, elsewhere[:_N_ADAPTED])
            found.append((task, cell, training))
    return _retrained(base, found, "trained on")


def _fast(subject: Subject) -> Plan:
    """Return the plan at 1 kHz, which no recording has: a synthetic hand, with a model of its own first rows."""
    source = "source={kind: synthetic, hands: [left]}"
    names = tuple(dict.fromkeys((HOLD, subject.estimator)))
    n_rows = _FAST_LEARNED_ROWS if is_learned(subject.method) else _FAST_ROWS
    rows = f"identification.train_samples={n_rows}"
    settings = (source, _AT_DELAY, *_FAST, rows)
    request = Request("default", settings, names, n_seeds=1, seed=subject.seed, duration_s=_FAST_S)
    return make_plan(request)


def _of_task(cell: Cell, task: str, names: Sequence[str]) -> Training:
    """Return the training on trials of another task."""
    raw = dump(cell.scenario)
    raw["source"] |= {"task": task, "trial": names[0]}
    raw["duration_s"] = 1.0  # the trial is read for its arms only
    training = training_of(build_scenario(raw, cell.scenario.name))
    assert training is not None
    return training_on(training, names, task)


def _retrained(base: Plan, found: Sequence[tuple[str, Cell, Training]], axis: str) -> Plan:
    """Return a plan whose points are the labels, each with the cells and trainings of its own."""
    labels = dict.fromkeys(label for label, _, _ in found)
    return replace(
        base,
        axes=(axis,),
        points=tuple(Point(label, {axis: label}) for label in labels),
        trainings={training.digest: training for _, _, training in found},
        cells=tuple(cell_of(cell.scenario, label, cell.trial, training, {}) for label, cell, training in found),
    )


def _training(plan: Plan, cell: Cell) -> Training:
    assert cell.training is not None
    return replace(plan.trainings[cell.training], scenario=cell.scenario)


def _named(plan: Plan, method: str) -> Plan:
    """Return the plan with the method in the labels of its trainings, so that a failure names it."""
    named = {
        digest: replace(training, label=f"{method}, {training.label}", timed=False)
        for digest, training in plan.trainings.items()
    }
    return replace(plan, trainings=named)
