"""The fit of one direction of a network to its record: pipeline stages, joint states, and their uncertainty."""

from math import log, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.metrics.loss import GilbertFit, fit_gilbert
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.fit.backlogs import Backlogs
from tis.netem.fit.closure import Closure
from tis.netem.fit.half_life import HalfLife, fit_half_life
from tis.netem.fit.loss_chain import Bools, loss_stage
from tis.netem.fit.marginal import Marginal, MarginalName, fit_marginal, quantile_table
from tis.netem.fit.outages import FoundOutages, FoundStalls, find_outages
from tis.netem.fit.record import DirectionRecord, Spread, rounded
from tis.netem.fit.steps import FoundSteps

_ALWAYS: Final = 0.98
_CERTAIN: Final = 3.0
_MIN_DELAYS: Final = 5
_ALIKE: Final = 1.2
_NOTICED: Final = 0.1
_TOLERANCE: Final = 0.03


class FittedState(NamedTuple):
    """One state: its ``name``, the fields of its duration and succession, and what it changes in a pipeline."""

    name: str
    duration: dict[str, Any]
    change: dict[str, Any]


class JointStates(NamedTuple):
    """The states of one direction; ``kind`` is ``markov`` or ``cycle``, ``note`` describes how they were found."""

    kind: str
    states: tuple[FittedState, ...]
    note: str

    def network(self, *directions: Direction) -> dict[str, Any]:
        """Return the states as in a network, with the same change in each of ``directions``."""
        return {
            "kind": self.kind,
            "states": [
                {"name": state.name, **state.duration}
                | (dict.fromkeys(directions, state.change) if state.change else {})
                for state in self.states
            ],
        }


def change_of(delay_ns: NDArray[np.int64], in_base_ns: NDArray[np.int64]) -> dict[str, Any]:
    """Return what a state changes in the pipeline of the base state, from the messages of both.

    ``delay_ns`` (n,) and ``in_base_ns`` (m,) are negative where lost. A delay that is only shifted becomes
    ``add_delay_ms``; one that has another spread becomes a table of quantiles.
    """
    lost, lost_in_base = delay_ns < 0, in_base_ns < 0
    if len(lost) and lost.mean() > _ALWAYS:
        return {"outage": True}
    change: dict[str, Any] = {}
    expected = float(lost_in_base.mean()) * len(lost)
    if abs(int(lost.sum()) - expected) > _CERTAIN * sqrt(expected + 1):
        change["loss"] = loss_stage(lost) or {"kind": "bernoulli", "p_loss": 0.0}
    there, base = delay_ns[~lost] / NS_PER_MS, in_base_ns[~lost_in_base] / NS_PER_MS
    if len(there) < _MIN_DELAYS or not len(base):
        return change
    more, spread, of_spread = float(there.mean() - base.mean()), float(there.std()), float(base.std())
    alike = of_spread / _ALIKE <= spread <= of_spread * _ALIKE
    if alike and abs(more) <= _NOTICED * of_spread:
        return change
    if alike and more > 0:
        return {**change, "add_delay_ms": rounded(more)}
    return {**change, "delay": quantile_table(delay_ns[~lost], _TOLERANCE).stage(6)}


def earlier(change: dict[str, Any], by_ms: float) -> dict[str, Any]:
    """Return a change with delays that are ``by_ms`` shorter, and not below the shortest of its table."""
    if "add_delay_ms" in change:
        return {**change, "add_delay_ms": rounded(max(change["add_delay_ms"] - by_ms, 0.0))}
    if change.get("delay", {}).get("kind") != "quantiles":
        return change
    points = change["delay"]["points"]
    least_ms = points[0]["delay_ms"]
    shorter = [{**point, "delay_ms": rounded(max(point["delay_ms"] - by_ms, least_ms), 6)} for point in points]
    return {**change, "delay": {"kind": "quantiles", "points": shorter}}


_MIN_OVERTAKEN: Final = 1e-3
MIN_RECEIVED: Final = 30
"""With fewer, even the mean is uncertain by more than a third of the deviation, 1.96 / sqrt(30) if independent."""


class DirectionFit(NamedTuple):
    """The fitted ``stages`` of a pipeline, as in a scenario; ``overtaken`` is the share of overtaken messages.

    ``steady`` is the reason why the delay counts as constant, else empty. ``left_out`` is the record's. ``outages``
    were found in the record and taken out before the losses were fitted; ``states`` are joint states of delay and
    loss, as in a scenario but with a single ``change`` each, or None. ``stalls``, ``backlogs`` and ``steps`` are
    waits that were found in the record and taken out before the delays were fitted, or None.
    """

    stages: dict[str, Any]
    n: int
    n_lost: int
    duration_s: float
    marginal: Marginal
    half_life: HalfLife
    losses: GilbertFit
    overtaken: float
    steady: str
    left_out: tuple[str, ...]
    outages: FoundOutages
    states: JointStates | None = None
    stalls: FoundStalls | None = None
    backlogs: Backlogs | None = None
    steps: FoundSteps | None = None
    closures: tuple[Closure, ...] = ()
    n_replays: int = 0

    @property
    def has_one_regime(self) -> bool:
        """Tell whether the delays are drawn from one distribution all the time."""
        return self.states is None and self.stalls is None and self.backlogs is None and self.steps is None

    def network(self, *directions: Direction) -> dict[str, Any]:
        """Return the fit as a network whose ``directions`` all have it."""
        found: dict[str, Any] = dict.fromkeys(directions, self.stages)
        way = {} if len(directions) > 1 else {"direction": directions[0]}
        processes = (self.outages.process, None if self.stalls is None else self.stalls.process)
        if outages := [{**process, **way} for process in processes if process is not None]:
            found["outages"] = outages
        if self.steps is not None:
            found["steps"] = [{**self.steps.process, **way}]
        if self.states is not None:
            found["states"] = self.states.network(*directions)
        return found


def fit_direction(
    record: DirectionRecord, wanted: MarginalName | None = None, regime: Bools | None = None
) -> DirectionFit:
    """Fit delay, correlation, loss and ordering; raises ValueError if the record is too short.

    A delay that varies by no more than measuring adds is constant, unless another distribution is ``wanted``. Outages
    are taken out first. Losses are independent, Gilbert's, or Gilbert and Elliott's, by BIC. The ordering is
    ``reorder`` if more than one message in a thousand was overtaken, and ``drop_late`` if the record has messages
    that were dropped for being late. Only messages of ``regime`` (N,) count where it is given. Oracle: known models,
    fitted, simulated and measured again, tests/deploy/net/test_round_trip.
    """
    trace = record.trace
    lost = trace.delay_ns < 0
    if int((~lost).sum()) < MIN_RECEIVED:
        raise ValueError(f"must have at least {MIN_RECEIVED} messages that arrived, has {int((~lost).sum())}")
    # Stage 1: outages, which neither bursts nor delays are to explain.
    outages = find_outages(trace)
    kept = ~outages.within if regime is None else regime & ~outages.within
    received = kept & ~lost
    n_received = int(received.sum())
    # Stage 2: delay and its correlation, which decides how many delays count as independent.
    sent_ns, delay_ns = trace.sent_ns[received], trace.delay_ns[received]
    duration_s = float(trace.sent_ns[-1] - trace.sent_ns[0]) / NS_PER_S
    steady = steady_reason(delay_ns, record.adds) if wanted in (None, "constant") else ""
    half_life = HalfLife(None, None, None, "the delay is constant") if steady else fit_half_life(sent_ns, delay_ns)
    marginal = fit_marginal(
        delay_ns, _n_independent(n_received, duration_s, half_life), wanted or ("constant" if steady else None)
    )
    # Stage 3: ordering, by all messages.
    overtaken = record.overtaken
    if overtaken is None:
        arrived_ns = (trace.sent_ns + trace.delay_ns)[~lost]
        overtaken = float(np.mean(arrived_ns < np.maximum.accumulate(arrived_ns)))
    # Stage 4: the stages of a pipeline.
    stages: dict[str, Any] = {}
    if (loss := loss_stage(lost[kept], np.diff(np.flatnonzero(kept)) == 1)) is not None:
        stages["loss"] = loss
    stages |= _copy_and_flip_stages(record, n_received)
    stages["delay"] = marginal.stage
    if half_life.seconds is not None and marginal.chosen != "constant":
        stages["correlation"] = {"half_life_s": rounded(half_life.seconds)}
    if record.n_dropped_late:
        stages["ordering"] = "drop_late"
    elif overtaken > _MIN_OVERTAKEN:
        stages["ordering"] = "reorder"
    return DirectionFit(
        stages,
        len(lost),
        int(lost.sum()),
        duration_s,
        marginal,
        half_life,
        fit_gilbert(lost[kept]),
        overtaken,
        steady,
        record.left_out,
        outages,
    )


def steady_reason(delay_ns: NDArray[np.int64], adds: Spread) -> str:
    """Return why delays, (N,), N > 0, count as constant; empty if they vary by more than ``adds``."""
    if delay_ns.min() == delay_ns.max():
        return "all delays are equal"
    spread = Spread.of(delay_ns)
    if not spread.within(adds):
        return ""
    varies_ms, adds_ms = spread.most_ns / NS_PER_MS, adds.most_ns / NS_PER_MS
    late_ns = delay_ns - np.median(delay_ns)
    n_late = int(np.count_nonzero(late_ns > adds.most_ns))
    stalls = f"; {n_late} of {len(delay_ns)} came up to {late_ns.max() / NS_PER_MS:.3g} ms later, as after stalls"
    reason = f"varies by {varies_ms:.2g} ms (p95 - p5), no more than the {adds_ms:.2g} ms that measuring may add"
    return reason + (stalls if n_late else "")


def _n_independent(n: int, duration_s: float, half_life: HalfLife) -> float:
    """Return the effective number of independent delays: the record's length over twice the correlation time."""
    if half_life.seconds is None:
        return n
    return min(float(n), duration_s * log(2) / (2 * half_life.seconds))


def _copy_and_flip_stages(record: DirectionRecord, n_received: int) -> dict[str, Any]:
    """Return the stages for duplicated and corrupted messages, if the record has any."""
    stages: dict[str, Any] = {}
    if record.n_copied:
        stages["duplicate"] = {"p_duplicate": rounded(record.n_copied / n_received)}
    if record.flips is not None and record.flips.n:
        stages["corrupt"] = {"p_corrupt": rounded(record.flips.n / n_received), "bits": record.flips.bits}
    return stages
