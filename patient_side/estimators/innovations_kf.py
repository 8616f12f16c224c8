"""The Kalman filter of the arm's own movement: source time, freshest first, predicted by the real age.

Samples of the arm are assimilated in the order of their source stamps, however they arrive, and the forecast reaches
from the newest one to now, fractions of a sample included. Where a gain alone relates the arm to its command, a
command stands in for an arm sample that has not arrived: through the gain, about the offset between the two at the
freshest samples that both streams have. Two streams with separate fates are then worth twice the packets.

The filter's grid goes through the newest sample's own stamp. Where stamps are uneven, each sample moves it: the last
ones are assimilated again, as interpolated at the moved instants.

A late sample is replayed from a checkpoint if it lies in the window that the model determines (`replay_window`);
older ones are ignored. Within the window the order of arrival does not affect the result.

Where the arm lags behind its command, the model is that of the command's movement with the arm's response to it
(`ArmModel.commanded`), and samples of both streams are assimilated, each where it has arrived: what has been
commanded need not be foretold, and only the commands to come are forecast as a movement. Such an arm is pulled to
its command, about an offset that drifts; several innovations that no command explains show a new one (`_astray`).

Where the model has a correction, the forecast also depends on the state of the hand's movement: its speed and
braking, the opening of the gripper, the recent path, and the phase of the clock behind the rows (`correction`), and
where training had three people or more on how tool and gripper move (`heads`). In an
outage the forecast comes to rest, at the level about which the arm moves where the model has one, and stays constant
after 5 s.
"""

from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.activity import Activity, ActivityMean
from tis.patient_side.filters.correction import Seen, clock_of
from tis.patient_side.filters.heads import Heads
from tis.patient_side.filters.innovations_filter import (
    ARM,
    AXES,
    BOTH,
    COMMAND,
    InnovationsFilter,
    build_innovations_filter,
    correct,
    follow_jump,
    square_of,
)
from tis.patient_side.filters.lag_forecast import LagForecasts
from tis.patient_side.filters.recent_past import WAY_UNKNOWN, RecentPast
from tis.patient_side.filters.replay import (
    Astray,
    Checkpoint,
    Ring,
    Uncertainty,
    UncertaintyTree,
    replay_window,
    rewound,
    trimmed,
)
from tis.patient_side.filters.row_clock import NO_PHASE, Phasor, RowClock
from tis.patient_side.filters.stand_in import PAIRS, Offset, StandIn
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.horizon import PATIENCE_SAMPLES, horizon_samples
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_INCREMENTS, InnovationsModel
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

_CHECK_EVERY = 4
"""Samples between two checks whether a broken row counts as unbroken again."""

_JUMP = 500.0
"""Squared innovation over its expectation, and over the hand's activity, that is no movement but a jump."""

_ASTRAY = 100.0
"""Square of the arm's own innovation over its expectation, and the hand's activity, that no command explains."""

_N_SETTLED = 2 * N_INCREMENTS
"""Samples of a row after which the arm's own innovation is as large as usual."""

_N_ASTRAY = 3
"""Number of such innovations in about the same direction that show a new offset between command and arm."""

_LIKELY = 9.0
"""Square of a way over its variance, as long as nothing is known of it, up to which it is no offset of a set-up."""

_NEGLIGIBLE = 0.05
"""Share of the innovations' variance below which the filter ignores a command's error; the estimate includes it."""

_UNEVEN_WINDOW = 16
"""Samples behind the newest that are assimilated anew with it where stamps are uneven."""


class InnovationsState(NamedTuple):
    """The samples assimilated so far: counts of both streams, checkpoints, and the freshest indices that both have.

    ``guessed``: the filter began with commands about an offset that no sample of the arm has confirmed. ``offset`` is
    the one at these indices, once it has been computed. ``seen`` is what the heads made of the newest sample.
    """

    n_arm: int
    n_command: int
    ring: Ring
    pairs: tuple[int, ...]
    guessed: bool
    offset: Offset | None = None
    seen: Seen | None = None


class _Pull(NamedTuple):
    """Of an arm that is pulled to its command: the share of its way per sample, and what is usual, in m^2.

    ``share`` is that of the command's innovation in the arm's; ``own_m2`` is the expected square of the arm's own
    innovation, and ``way_m2`` that of its way before it has been seen to go.
    """

    per_sample: float
    share: float
    own_m2: float
    way_m2: float

    @classmethod
    def of(cls, model: InnovationsModel) -> "_Pull | None":
        """Return the pull of a model's response, if it has one."""
        if model.response is None or not model.response.pull:
            return None
        response, unit_m2 = model.response, float(np.trace(model.Re))
        return cls(response.pull, float(response.command[0]), response.noise * unit_m2, WAY_UNKNOWN * unit_m2)


@dataclass(frozen=True)
class InnovationsKf:
    """No estimate before the first arrival; without samples of the arm it begins with commands, if a gain is known.

    ``window`` is the number of samples behind the newest up to which a late one is replayed, by default the model's
    `replay_window`. More than 5 s after the freshest sample the estimate stays constant, and a gap of more than 5 s
    restarts the filter. Oracles: one-shot conditioning of the joint Gaussian, consistency on data of the model.
    """

    model: ArmModel
    name: str = "innovations_kf"
    window: int = -1
    place: int | tuple[slice, int] = field(init=False, repr=False)
    """Where the mean of a checkpoint has the arm's position (3,)."""
    _filter: InnovationsFilter = field(init=False, repr=False)
    _unbroken: Unbroken = field(init=False, repr=False)
    _tree: UncertaintyTree = field(init=False, repr=False)
    _forecasts: LagForecasts = field(init=False, repr=False)
    _stand_in: StandIn | None = field(init=False, repr=False)
    _activity: ActivityMean = field(init=False, repr=False)
    _clock: RowClock | None = field(init=False, repr=False)
    _heads: Heads | None = field(init=False, repr=False)
    _negligible_error: bool = field(init=False, repr=False)
    _gain: Array | None = field(init=False, repr=False)
    _pull: _Pull | None = field(init=False, repr=False)
    _usual: int = field(init=False, repr=False)
    _shown: tuple[slice, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        innovations = self.model.commanded or self.model.innovations
        if innovations is None:
            rule = "innovations_kf needs the innovations form of the arm's movement; the file holds none"
            raise DataError(Fault("model", "innovations", rule))
        response = innovations.response
        stand_in = StandIn.of(self.model) if response is None else None
        small = stand_in is not None and np.trace(stand_in.error_m2) <= _NEGLIGIBLE * np.trace(innovations.Re)
        horizon, uncertain = horizon_samples(self.model.rate_hz), stand_in is not None and not small
        correction = innovations.correction
        with_past = correction is not None or response is not None
        past = RecentPast.at_rate(self.model.rate_hz) if with_past else None
        filter_ = build_innovations_filter(innovations, horizon, whole=uncertain, past=past)
        unbroken = Unbroken.of(filter_)
        object.__setattr__(self, "place", -1 if filter_.n_axes == 1 else (slice(-AXES, None), 0))
        object.__setattr__(self, "_filter", filter_)
        object.__setattr__(self, "_unbroken", unbroken)
        object.__setattr__(self, "_tree", UncertaintyTree(filter_))
        object.__setattr__(self, "_clock", None if correction is None else clock_of(correction))
        heads = None if correction is None else Heads.of(correction, filter_, self.model.rate_hz)
        object.__setattr__(self, "_heads", heads)
        object.__setattr__(self, "_activity", ActivityMean.at_rate(self.model.rate_hz))
        forecasts = LagForecasts.of(innovations, filter_, unbroken, self.model.rate_hz)
        object.__setattr__(self, "_forecasts", forecasts)
        object.__setattr__(self, "_stand_in", stand_in)
        object.__setattr__(self, "_gain", None if response is None else response.gain)
        object.__setattr__(self, "_pull", _Pull.of(innovations))
        object.__setattr__(self, "_usual", filter_.usual)
        object.__setattr__(self, "_shown", tuple(map(filter_.shown, (ARM, COMMAND, BOTH))))
        object.__setattr__(self, "_negligible_error", bool(small))
        if self.window < 0:
            object.__setattr__(self, "window", replay_window(filter_, unbroken))

    def initial(self) -> InnovationsState:
        """Return the state before the first arrival."""
        return InnovationsState(0, 0, (), (), guessed=False)

    def step(self, state: InnovationsState, playout: Playout, now_ns: int) -> tuple[InnovationsState, Estimate]:
        """Return the state after what has arrived, and the estimate for ``now_ns``."""
        # Assimilate new arrivals: the common case, the next sample in order, has a short cut.
        if playout.arm.n_added != state.n_arm or playout.command.n_added != state.n_command:
            state = self._in_order(state, playout) or self._assimilate(state, playout)
            if self._heads is not None and state.ring:
                state = state._replace(seen=self._seen(state.ring[-1], playout, self._heads))
        if not state.ring:
            return state, Estimate(None)
        # Forecast over the lag since the newest sample; its covariance is precomputed after an unbroken row.
        newest = state.ring[-1]
        lag_ns = now_ns - sample_instant_ns(newest.source_index, playout.rate_hz)
        if playout.arm.uneven or playout.command.uneven:
            lag_ns -= playout.periods_ns(_late(playout, newest.source_index))
        if lag_ns < 0:  # of a clock ahead; no call, as this is done at each tick
            lag_ns = 0
        if newest.uncertainty is None:
            forecast = self._forecasts.after_unbroken(newest.length, lag_ns)
        else:
            forecast = self._forecasts.after(newest.uncertainty.covariance, lag_ns)
        # The position from the mean, corrected by the state of the hand's movement where the model has a correction.
        # That of an arm behind its command is fitted where both are known, and would mistake a command for them.
        mean, activity, correction = newest.mean, newest.activity[0], forecast.correction
        if correction is None or (self._gain is not None and not newest.length):
            position = forecast.weights.dot(mean).reshape(AXES)
        else:
            gripper_rad = playout.arm.gripper_rad(newest.source_index)
            position = correction.position(mean, activity, gripper_rad, newest.phasor, state.seen)
        # The covariance, scaled by the hand's activity, with the error that the filter ignored.
        spread = activity * forecast.spread
        if newest.error is not None:
            spread += newest.error
        return state, Estimate(position, spread)

    def _in_order(self, state: InnovationsState, playout: Playout) -> InnovationsState | None:
        """Return the state after the next sample of the arm, alone or with its command; else None.

        Where commands can stand in, it is the one after the last; else others may be missing between the two.
        """
        arm, command = playout.arm, playout.command
        ring = state.ring
        if not ring or state.guessed or arm.n_added != state.n_arm + 1:
            return None
        before = ring[-1]
        index = arm.newest
        pairs, offset, n_commands = state.pairs, state.offset, command.n_added - state.n_command
        follows = n_commands == 1 and command.last_arrived == index == command.newest and not command.uneven
        if arm.last_arrived != index or arm.uneven or (self._gain is not None and not follows):
            return None
        if self._stand_in is not None:
            if index != before.source_index + 1 or before.uncertainty is not None or n_commands > 1:
                return None
            if n_commands:
                if command.last_arrived != index or not pairs:
                    return None
                pairs, offset = (*pairs[1 - PAIRS :], index), None
            elif command.newest >= index:
                return None
        sample, what = (arm.get(index), ARM) if self._gain is None else self._sample(playout, index)
        if sample is None:
            return None
        ring = (*ring[-1 - self.window :], self._after(before, index, sample, None, what))
        return InnovationsState(arm.n_added, command.n_added, ring, pairs, False, offset)

    def _assimilate(self, state: InnovationsState, playout: Playout) -> InnovationsState:
        """Return the state after the new arrivals, in whatever order."""
        arm, command = playout.arm, playout.command
        new = arm.added_since(state.n_arm)
        new += [] if self._gain is None else command.added_since(state.n_command)
        _, _, ring, pairs, guessed, offset, _ = state
        # Which indices to assimilate, and which both streams have now.
        if self._stand_in is not None:
            commands = command.added_since(state.n_command)
            paired = [i for i in new if i in command]
            if paired and self._negligible_error and ring:
                # A command that stood in earlier for one of these was as good: no replay.
                newest = ring[-1].source_index
                new = [i for i in new if i >= newest or i not in command or i in commands]
            for i in commands:
                (paired if i in arm else new).append(i)
            if paired:
                pairs = tuple(sorted({*pairs, *paired})[-PAIRS:])
                if pairs != state.pairs:
                    offset = None
            if guessed and arm.newest >= 0:
                ring, guessed = (), False
        # The source index to replay from: the oldest new sample within the window; none (-1) if all are older.
        oldest = ring[-1].source_index - self._window_of(playout) if ring else 0
        if not ring or (pairs and not state.pairs):
            first = max(oldest, 0)
        else:
            first = -1
            for i in new:
                if i >= oldest and (i < first or first < 0):
                    first = i
        now = InnovationsState(arm.n_added, command.n_added, ring, pairs, guessed, offset)
        return self._replayed(now, playout, first) if first >= 0 else now

    def _replayed(self, state: InnovationsState, playout: Playout, first: int) -> InnovationsState:
        """Return the state after a run from source index ``first`` through all samples that have arrived."""
        arm, command = playout.arm, playout.command
        n_arm, n_command, ring, pairs, _, offset, _ = state
        # Rewind to the last checkpoint before it; without one, begin within the horizon of the newest sample.
        is_uneven = bool(arm.uneven or command.uneven)
        run = list(rewound(ring, first)[: 1 if is_uneven else None])
        before = run[-1] if run else None
        # Until an offset is known, commands are used only where there are no samples of the arm at all.
        stand_in = self._stand_in if pairs or arm.newest < 0 else None
        if before is not None:
            begun = before.source_index
        else:
            alone = stand_in is None and self._gain is None
            newest = arm.newest if alone else max(arm.newest, command.newest)
            begun = max(newest - self._filter.horizon, -1)
        # Run through the indices of either stream: the arm's sample where it has arrived, else the command.
        indices = arm.after(begun)
        if stand_in is not None or self._gain is not None:
            indices = sorted({*indices, *command.after(begun)})
        # The grid of the run goes through the newest sample's own stamp.
        late = _late(playout, indices[-1]) if is_uneven and indices else 0.0
        if before is not None and is_uneven:
            run[-1] = before = self._moved(before, playout, late)
        for index in indices:
            (sample, what), error = self._sample(playout, index, late), None
            if sample is None:
                through = command.at(index, late)
                assert through is not None, "one of the streams has it"
                assert stand_in is not None, "commands are looked for only where they can stand in"
                if offset is None:
                    offset = stand_in.offset(pairs, playout)
                sample, error = stand_in.gain.dot(through) + offset.offset_m, offset.error_m2
            before = self._after(before, index, sample, error, what)
            if is_uneven:
                before = before._replace(late=late)
            run.append(before)
        if not run:
            return state
        guessed = stand_in is not None and not pairs
        window = max(self._window_of(playout), _UNEVEN_WINDOW) if is_uneven else self._window_of(playout)
        return InnovationsState(n_arm, n_command, trimmed(tuple(run), window), pairs, guessed, offset)

    def _seen(self, newest: Checkpoint, playout: Playout, heads: Heads) -> Seen | None:
        """Return what the heads make of the newest sample: nothing of a command that stands in for one."""
        index = newest.source_index
        if index not in playout.arm:
            return None
        return heads.seen(newest.mean, newest.activity[0], playout, index)

    def _window_of(self, playout: Playout) -> int:
        """Return how far behind the newest sample a late one is replayed: with commands behind the later stream."""
        if self._gain is None:
            return self.window
        return self.window + min(abs(playout.arm.newest - playout.command.newest), PATIENCE_SAMPLES)

    def _sample(self, playout: Playout, index: int, late: float = 0.0) -> tuple[Array | None, int]:
        """Return what has arrived of an index, and what it shows: the arm alone unless it follows its command.

        It is stated at ``late`` periods after the plan's instant.
        """
        sample = playout.arm.at(index, late)
        if self._gain is None:
            return sample, ARM
        command = playout.command.at(index, late)
        if command is None:
            return sample, ARM
        if sample is None:
            return self._gain.dot(command), COMMAND
        both = np.empty(2 * AXES)
        self._gain.dot(command, out=both[:AXES])
        both[AXES:] = sample
        return both, BOTH

    def _moved(self, before: Checkpoint, playout: Playout, late: float) -> Checkpoint:
        """Return a checkpoint as a grid at ``late`` periods after the plan's instants sees it."""
        index = before.source_index
        (was, what), (now, _) = self._sample(playout, index, before.late), self._sample(playout, index, late)
        if was is None or now is None or not (self._gain is None or what == BOTH):
            return before
        mean = before.mean.copy()
        mean[self._shown[what]] += (now - was).reshape(-1, mean.shape[1])
        return before._replace(mean=mean, late=late)

    def _complete(self, sample: Array, what: int) -> Array:
        """Return positions of command and arm (6,) where only one of them is known."""
        if what == BOTH or self._gain is None:
            return sample
        offset_m = self._offset_m()
        return np.concatenate([sample, sample + offset_m] if what == COMMAND else [sample - offset_m, sample])

    def _offset_m(self) -> Array:
        """Return the offset (3,) in m of the arm from its command in the middle of the training rows."""
        assert self._gain is not None
        return np.asarray(self.model.output_offset_m - self._gain.dot(self.model.input_offset_m))

    def _after(
        self, before: Checkpoint | None, index: int, sample: Array, error: Array | None, what: int
    ) -> Checkpoint:
        """Return the checkpoint after a sample of ``what`` at source index ``index``, with its ``error`` if any."""
        filter_, unbroken, ignored = self._filter, self._unbroken, None
        if self._negligible_error:
            ignored, error = error, None
        # First sample, or first after a gap beyond the horizon: start.
        if before is None or index - before.source_index > filter_.horizon:
            activity = self._activity.initial() if before is None else before.activity
            return self._begun(index, sample, what, error, ignored, activity)
        last, mean, start, length, _, activity, phasor, _, _, _ = before
        gap = index - last
        # Unbroken row: the gain is precomputed. The row breaks with a gap or an uncertain sample.
        if start is None:
            if gap == 1 and error is None and what == self._usual:
                stage = unbroken.stage(length + 1)
                mean = filter_.onward[1].dot(mean)
                gain = unbroken.gains[stage], unbroken.variances[stage]
                activity, jump, astray = self._corrected(mean, *gain, sample, what, before)
                if jump is before.jump is not None:
                    return self._begun(index, sample, what, None, ignored, activity)
                phasor = self._phasor(phasor, 1, mean, activity[0])
                return Checkpoint(index, mean, None, length + 1, ignored, activity, phasor, jump, astray)
            stage = unbroken.stage(length)
            start = self._tree.root(stage, unbroken.covariances[stage])
        # Uncertain sample: the full update, as the cache below holds those of certain samples only.
        if error is not None:
            updated = filter_.update(mean, start.covariance, gap, sample, error)
            activity = self._activity.after(activity, updated.surprise)
            phasor = self._phasor(phasor, gap, None, 0.0)
            return Checkpoint(index, updated.mean, Uncertainty(updated.covariance), 0, ignored, activity, phasor)
        # Certain sample in a broken row: the covariance is cached by its gaps.
        left = self._tree.take(start, gap, what)
        mean = filter_.onward[gap].dot(mean)
        activity, jump, astray = self._corrected(mean, left.weights, left.variance, sample, what, before)
        if jump is before.jump is not None:
            return self._begun(index, sample, what, None, ignored, activity)
        # The last increments are evidence of the clock's phase where their samples have all arrived.
        phasor = self._phasor(phasor, gap, mean if gap == 1 and length >= N_INCREMENTS else None, activity[0])
        if gap > 1 or what != self._usual:
            return Checkpoint(index, mean, left, 0, ignored, activity, phasor, jump)
        # The row counts as unbroken again once its covariance matches that of an unbroken one.
        length += 1
        matching = unbroken.length_like(left.covariance) if length % _CHECK_EVERY == 0 else 0
        if matching:
            return Checkpoint(index, mean, None, matching, ignored, activity, phasor, jump, astray)
        return Checkpoint(index, mean, left, length, ignored, activity, phasor, jump, astray)

    def _begun(
        self, index: int, sample: Array, what: int, error: Array | None, ignored: Array | None, activity: Activity
    ) -> Checkpoint:
        """Return the checkpoint of a row that begins with this sample."""
        mean, covariance = self._filter.start(self._complete(sample, what), error, what)
        if self._pull is not None and what == BOTH:
            # Where the set-up is that of the training, the way is known at once.
            way = sample[:AXES] + self._offset_m() - sample[AXES:]
            if square_of(way) <= _LIKELY * self._pull.way_m2:
                mean[self._filter.way] = way.reshape(-1, mean.shape[1])
        uncertainty = None if error is None and what == self._usual else Uncertainty(covariance)
        return Checkpoint(index, mean, uncertainty, 1, ignored, activity)

    def _corrected(
        self, mean: Array, gain: Array, variance: float, sample: Array, what: int, before: Checkpoint
    ) -> tuple[Activity, Array | None, Astray | None]:
        """Correct a predicted mean by a certain sample, or let it follow a jump, in place.

        Return the activity, the innovation of a jump, if it is one, and that of an arm gone astray. After a jump a
        second one in about the same direction shows that the movement has changed, as of a hand that stopped at once,
        and the innovation of the first is returned: its row ends, as this one, followed, would seem to jump for ever.
        One in the opposite direction is the end of an outlier.
        """
        shown = self._shown[what]
        innovation = correct(mean, gain, sample, shown)
        surprise = square_of(innovation) / variance
        activity, jump = before.activity, before.jump
        if surprise <= (_JUMP * activity[0] if activity[0] > 1.0 else _JUMP):  # no call, as at each sample
            astray = None if self._pull is None or what != BOTH else self._astray(mean, innovation, before)
            return self._activity.after(activity, surprise), None, astray
        # The first three numbers are comparable, of whatever the two samples show.
        if jump is None or jump.ravel()[:AXES].dot(innovation.ravel()[:AXES]) <= 0.0:
            follow_jump(mean, gain, innovation, shown)
            jump = innovation
        return self._activity.after(activity, surprise), jump, None

    def _astray(self, mean: Array, innovation: Array, before: Checkpoint) -> Astray | None:
        """Return the arm's own innovation where no command explains it, and what it shows of the mean, in place.

        One is a blow, or an error of the sensor. Several in about the same direction, one after the other, are a
        clutch, a stop or a new set-up: the offset between command and arm, which drifts slowly, has changed at once.
        Then the way is the one that explains the newest.
        """
        assert self._pull is not None
        d, pull = self._filter.n_axes, self._pull
        own = innovation[d:] - pull.share * innovation[:d]
        if before.length < _N_SETTLED or square_of(own) <= _ASTRAY * pull.own_m2 * max(before.activity[0], 1.0):
            return None
        found = Astray(own, 1)
        if before.astray is not None and before.astray.own.ravel().dot(own.ravel()) > 0.0:
            found = Astray(own, before.astray.n + 1)
        if found.n >= _N_ASTRAY:
            way = mean[self._filter.way] + own / pull.per_sample
            too_far = square_of(way) / (_LIKELY * pull.way_m2)
            mean[self._filter.way] = way / sqrt(too_far) if too_far > 1.0 else way
        return found

    def _phasor(self, before: Phasor, gap: int, mean: Array | None, activity: float) -> Phasor:
        """Return the phasor of the clock behind the rows ``gap`` rows later, with evidence from a mean if any."""
        if self._clock is None:
            return NO_PHASE
        increments = [] if mean is None else mean.ravel()[: AXES * N_INCREMENTS].tolist()
        return self._clock.after(before, gap, increments, activity)


def _late(playout: Playout, index: int) -> float:
    """Return how many periods after the plan's instant a sample was taken that has arrived in either stream."""
    stream = playout.arm if index in playout.arm else playout.command
    return stream.taken(index).late if stream.uneven else 0.0
