"""The entry point of training: the learned models of arms whose linear models are identified."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.util import find_spec
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import Fault, InputError
from tis.common.extras import GET_LEARNED
from tis.common.scenario.estimator_names import LearnedName
from tis.common.scenario.identification import Identification, Learning
from tis.common.sources.trajectory import Recording
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.learned_forecast import linear_forecast
from tis.patient_side.identification.companions import Stage, untimed
from tis.patient_side.identification.dataset import training_set
from tis.patient_side.identification.validation import fewest_rows
from tis.patient_side.learned.gaussian_process import AGES, features_of, outputs
from tis.patient_side.learned.inputs import stride_of
from tis.patient_side.learned.networks import NETWORKS
from tis.patient_side.learned_model import VERSION, LearnedModel, Singles, Training
from tis.patient_side.learning import calibration
from tis.patient_side.learning.examples import Examples, Track, examples_of
from tis.patient_side.learning.fit_gpr import fit_gpr
from tis.patient_side.learning.fit_network import Epoch, Judged, judge, some_of, train_network
from tis.patient_side.learning.fit_srlsmf import fit_srlsmf
from tis.patient_side.learning.process_scales import Noise, inverse_lengths, turned
from tis.patient_side.model_fields import Floats
from tis.patient_side.statespace import ArmModel

# The examples on which training is judged: people, else trials, else the end of the only trial.

_FIRST_PART: Final = 0.7
_SHARE: Final = 5


def grouped(tracks: Sequence[Track], people: Sequence[str], labels: Sequence[str]) -> list[Track]:
    """Return the tracks with their groups: people where there are several, else trials, else two parts of one."""
    names = people if len(set(people)) > 1 else labels
    if len(set(names)) > 1:
        return [track._replace(group=name) for track, name in zip(tracks, names, strict=True)]
    parts = []
    for track in tracks:
        cut = round(_FIRST_PART * len(track.position_m))
        for rows, name in ((slice(0, cut), "first rows"), (slice(cut, None), "last rows")):
            parts.append(Track(track.position_m[rows], track.gripper_rad[rows], name))
    return parts


def held_out(names: Sequence[str], seed: int) -> tuple[str, ...]:
    """Return the groups to hold out: a fifth of them, at least one, by turns over the seeds; none of a single one."""
    if len(names) < 2:
        return ()
    n_held = max(1, len(names) // _SHARE)
    return tuple(sorted(names[(seed * n_held + i) % len(names)] for i in range(n_held)))


def is_in(groups: NDArray[np.int64], names: Sequence[str], held: Sequence[str]) -> NDArray[np.bool_]:
    """Return which examples of ``groups`` (B,), numbers in ``names``, belong to the groups ``held``."""
    return np.isin(groups, [names.index(name) for name in held])


Progress = Callable[[Epoch], None]


def silent(_: Epoch) -> None:
    """Report nothing."""


def check_extra(names: Sequence[LearnedName]) -> None:
    """Raise `InputError` where a package is missing that the training of a method needs."""
    faults = []
    for name in names:
        needed = ("jax", "optax") if name in NETWORKS else ("sklearn",)
        missing = [package for package in needed if find_spec(package) is None]
        if missing:
            rule = f"needs {' and '.join(missing)} to train {name}: {GET_LEARNED}"
            faults.append(Fault("identification", "method", rule))
    if faults:
        raise InputError(faults)


def with_learned(
    models: Sequence[ArmModel],
    trainings: Sequence[Recording],
    identification: Identification,
    names: Sequence[LearnedName],
    stage: Stage = untimed,
    progress: Progress = silent,
) -> tuple[ArmModel, ...]:
    """Return the arms' models with learned ones beside them, trained on the same recordings.

    Parameters
    ----------
    models
        The identified models, one for each hand, with the innovations form of the movement.
    trainings
        The recordings that they were identified on. With ``identification.train`` of ``others`` the hands are pooled,
        and share the learned models.
    identification
        The scenario's settings; ``learning`` holds those of training.
    names
        The methods to train, in this order.
    stage
        Returns a context in which the model for the estimator of that name is trained.
    progress
        Receives the state of training after each epoch.

    Raises
    ------
    InputError
        Where the extra ``learned`` is missing.
    DataError
        Where the recordings are not usable.

    Notes
    -----
    Equal recordings, settings and library versions give equal models. Oracle: test_train, twice.
    """
    if not names:
        return tuple(models)
    check_extra(names)
    found: list[ArmModel] = []
    is_pooled = identification.train == "others"
    for model in models:
        if is_pooled and found:
            found.append(replace(model, learned=found[0].learned))
            continue
        rows = _Rows(linear_forecast(model), _tracks(model, trainings, identification, is_pooled), identification)
        learned = []
        for name in names:
            with stage(name):
                learned.append(_learned(name, rows, identification.learning, progress))
        found.append(replace(model, learned=tuple(learned)))
    return tuple(found)


def _tracks(
    model: ArmModel, trainings: Sequence[Recording], identification: Identification, is_pooled: bool
) -> list[Track]:
    shortest = fewest_rows(identification.block_rows)
    rows = training_set(trainings, model.hand, pool_hands=is_pooled, shortest=shortest)
    tracks = [Track(y, angles, "") for (_, y), angles in zip(rows.trials, rows.grippers_rad, strict=True)]
    return grouped(tracks, rows.people, rows.labels)


class _Rows:
    """The training rows of one model, in their units; examples are made once for all methods of a kind."""

    def __init__(self, linear: InnovationsKf, tracks: Sequence[Track], identification: Identification) -> None:
        stride = stride_of(linear.model.rate_hz)
        increments = np.concatenate([track.position_m[stride:] - track.position_m[:-stride] for track in tracks])
        self.usual_m = float(np.sqrt(np.mean(np.sum(increments**2, axis=1))))
        self.spread_rad = float(np.std(np.concatenate([track.gripper_rad for track in tracks])))
        self._linear, self._tracks, self._learning = linear, tracks, identification.learning
        self._made: dict[bool, _Judged] = {}

    def of(self, name: LearnedName) -> "_Judged":
        """Return the examples for a method: networks read drawn ages, processes those of their outputs."""
        is_network = name in NETWORKS
        if is_network not in self._made:
            seed, n_passes, ages = self._learning.seed, self._learning.passes, None if is_network else AGES
            whole = examples_of(self._tracks, self._linear, self.usual_m, self.spread_rad, seed, n_passes, ages)
            self._made[is_network] = _Judged.of(whole, seed)
        return self._made[is_network]


class _Judged(NamedTuple):
    """All examples; those to learn from at first; those of the groups ``names``, on which that is judged.

    With a single group, the rows' own errors are all there is: then all three are the same.
    """

    whole: Examples
    seen: Examples
    held: Examples
    names: tuple[str, ...]

    @classmethod
    def of(cls, whole: Examples, seed: int) -> "_Judged":
        names = held_out(whole.names, seed)
        chosen = is_in(whole.groups, whole.names, names)
        if chosen.all() or not chosen.any():
            return cls(whole, whole, whole, ())
        return cls(whole, whole.rows(np.flatnonzero(~chosen)), whole.rows(np.flatnonzero(chosen)), names)


def _learned(name: LearnedName, rows: _Rows, learning: Learning, progress: Progress) -> LearnedModel:
    examples = rows.of(name)
    train = _train_network if name in NETWORKS else _train_process
    weights, judged, errors, best = train(name, examples, learning, progress)
    held = examples.held
    share = calibration.mean_share(judged.mean, held)
    left = held.left - calibration.shared(judged.mean, share, held.ages)
    return LearnedModel(
        method=name,
        version=VERSION,
        usual_m=rows.usual_m,
        gripper_spread_rad=rows.spread_rad,
        scale_ages=calibration.AGES,
        mean_share=share,
        covariance_scale=calibration.covariance_scale(left, judged.log_deviation, held),
        weights=weights,
        training=Training(learning.seed, len(examples.whole), examples.names, best, errors),
    )


_Trained = tuple[dict[str, Singles], Judged, Floats, int]
"""Weights of all examples; the answers of those without the held-out ones; held-out errors; number of epochs."""


def _train_network(name: LearnedName, examples: _Judged, learning: Learning, progress: Progress) -> _Trained:
    network, seed, held = NETWORKS[name], learning.seed, examples.held
    first = train_network(name, network, examples.seen, held, seed, learning.epochs, learning.patience, progress)
    judged = judge(network, first.weights, held)
    if examples.seen is held:
        return dict(first.weights), judged, first.errors, first.best
    whole = train_network(name, network, examples.whole, None, seed, first.best, first.best, progress)
    return dict(whole.weights), judged, first.errors, first.best


def _train_process(name: LearnedName, examples: _Judged, learning: Learning, progress: Progress) -> _Trained:
    seed, held = learning.seed, examples.held
    seen = turned(examples.seen, seed)
    watched = some_of(seen)
    scale = inverse_lengths(features_of(seen.window), seen.left.astype(float), seed)

    def fit(rows: Examples, noise: Noise | None = None) -> tuple[dict[str, Singles], Noise]:
        if name == "gpr":
            return fit_gpr(rows, held, scale, seed, noise)
        return fit_srlsmf(rows, held, scale, seed, "largest" if name == "srlsmf" else "shrunk", noise)

    weights, noise = fit(seen)
    mean, deviation = outputs(weights, features_of(held.window))
    judged = Judged(mean, np.log(deviation))
    error = judged.error_of(held)
    of_seen = outputs(weights, features_of(watched.window))
    learned = Judged(of_seen[0], np.log(of_seen[1])).error_of(watched)
    progress(Epoch(name, 1, 1, learned, error))
    # From here on the held-out rows are known: the noise stays that of unknown ones.
    whole = weights if examples.seen is held else fit(turned(examples.whole, seed), noise)[0]
    return whole, judged, np.array([error]), 1
