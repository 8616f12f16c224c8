"""Benchmark of the patient's tick (`tis bench tick`): the time of its parts, and what it sends and records.

The patient of a twin is timed by the processor time of its thread, part by part; the rest is answers, set points and
records. Beside it stands a bare loop: the same twin whose patient does nothing. Times depend on the machine and its
load, counts do not: tests/deploy/bench/test_tick holds them.
"""

import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from types import FrameType
from typing import Any, Final, NamedTuple

from rich.console import Console

from tis.common.channels import Side
from tis.common.node import Arrival, Emission, Node, Output, Record
from tis.common.runtime.loop import Recorder
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_US
from tis.deploy.present.table import Column, Row, Table
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, drive
from tis.patient_side.external_arm import ExternalArm
from tis.patient_side.node import PatientNode

_SCENARIO: Final = "kilohertz"
_HANDS: Final[Mapping[str, str]] = {"one hand": "[left]", "both hands": "[left, right]"}
_RATES_HZ: Final = (30, 1000)
_TICK, _RECEIVE, _REST, _BARE = "tick", "receive", "answers and records", "bare loop"


class Counts(NamedTuple):
    """Means over the ticks of a twin: messages sent, records made (those of arrivals too), and calls of functions.

    ``calls`` are those of Python and of C within the ticks alone.
    """

    messages: float
    records: float
    calls: float


@dataclass
class _Timed:
    """A part of a hand, an estimator or an arm, whose step is timed."""

    inner: Any
    name: str
    spent_ns: dict[str, int]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def _time(self, call: Any, *arguments: Any) -> Any:
        begun_ns = time.thread_time_ns()
        found = call(*arguments)
        self.spent_ns[self.name] += time.thread_time_ns() - begun_ns
        return found

    def step(self, *arguments: Any) -> Any:
        return self._time(self.inner.step, *arguments)

    def estimate(self, *arguments: Any) -> Any:
        return self._time(self.inner.estimate, *arguments)


@dataclass
class _Watched:
    """The patient, each of whose calls is timed or, with ``counts_calls``, has its calls counted."""

    inner: PatientNode
    counts_calls: bool = False
    spent_ns: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    ticks: list[dict[str, int]] = field(default_factory=list)
    n_calls: int = 0
    n_messages: int = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def time_parts(self) -> None:
        """Put a clock around the parts of each hand."""
        for hand in self.inner.hands:
            hand.estimators = [_Timed(one, one.name, self.spent_ns) for one in hand.estimators]
            hand.methods = [_Timed(one, f"orientation: {one.name}", self.spent_ns) for one in hand.methods]  # type: ignore[misc]
            if hand.plant is not None and not isinstance(hand.plant, ExternalArm):
                hand.plant = _Timed(hand.plant, "arm", self.spent_ns)
            if hand.safety is not None:
                hand.safety = _Timed(hand.safety, "safety", self.spent_ns)  # type: ignore[assignment]

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        begun_ns = time.thread_time_ns()
        outputs = self.inner.receive(arrival)
        self.spent_ns[_RECEIVE] += time.thread_time_ns() - begun_ns
        return outputs

    def wake(self, now_ns: int) -> Iterable[Output]:
        if self.counts_calls:
            return self._counted(now_ns)
        begun_ns = time.thread_time_ns()
        outputs = list(self.inner.wake(now_ns))
        self.spent_ns[_TICK] += time.thread_time_ns() - begun_ns
        self.ticks.append(dict(self.spent_ns))
        self.spent_ns.clear()
        return outputs

    def _counted(self, now_ns: int) -> Iterable[Output]:
        n = 0

        def count(_: FrameType, event: str, __: object) -> None:
            nonlocal n
            n += event in ("call", "c_call")

        sys.setprofile(count)
        try:
            outputs = list(self.inner.wake(now_ns))
        finally:
            sys.setprofile(None)
        self.n_calls += n
        self.n_messages += sum(isinstance(output, Emission) for output in outputs)
        return outputs


class _Idle(NamedTuple):
    """A patient that ticks and does nothing."""

    inner: PatientNode

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def receive(self, _: Arrival) -> Sequence[Output]:
        return ()

    def wake(self, now_ns: int) -> Sequence[Output]:
        self.inner.ticker.skip_missed(now_ns)
        self.inner.ticker.begin()
        return ()


@dataclass
class _Counting:
    """Counts the records of a side, and keeps none."""

    n: int = 0

    def record(self, _: Record) -> None:
        self.n += 1


def bench_tick(seconds: float, rounds: int, out: Console) -> dict[str, Any]:
    """Time twins of ``seconds``, print a table for each rate, and return the times in us and the counts."""
    out.print(f"load average {os.getloadavg()[0]:.2f}; processor time of the patient's thread", soft_wrap=True)
    figures: dict[str, Any] = {}
    for rate_hz in _RATES_HZ:
        found = {hands: _measured(_scenario(rate_hz, text, seconds), rounds) for hands, text in _HANDS.items()}
        parts = dict.fromkeys(part for times, _ in found.values() for part in times)
        rows: list[Row] = [
            (part, *(f"{times[part]:.1f}" if part in times else "" for times, _ in found.values())) for part in parts
        ]
        rows.append(())
        rows += [(name, *(f"{getattr(n, name):.1f}" for _, n in found.values())) for name in Counts._fields]
        columns = [Column("", words=True), *(Column(hands, "us a tick") for hands in _HANDS)]
        out.print(Table(f"{rate_hz} ticks a second, {seconds:g} s", columns, rows).terminal())
        figures[str(rate_hz)] = {
            hands: {"us": times, "counts": counts._asdict()} for hands, (times, counts) in found.items()
        }
    return figures


def counts_of(scenario: Scenario) -> Counts:
    """Return what a tick sends, records and calls, over a twin of the scenario."""
    patient, recorder = _patient(nodes := build_sides(scenario)[0]), _Counting()
    watched = _Watched(patient, counts_calls=True)
    _drive(scenario, nodes, watched, recorder)
    n_ticks = patient.ticker.k
    return Counts(watched.n_messages / n_ticks, recorder.n / n_ticks, watched.n_calls / n_ticks)


def _scenario(rate_hz: int, hands: str, seconds: float) -> Scenario:
    settings = (f"source.hands={hands}", f"rate_hz={rate_hz}", f"duration_s={seconds}")
    return resolve(_SCENARIO, settings, None, None)


def _measured(scenario: Scenario, rounds: int) -> tuple[dict[str, float], Counts]:
    """Return the least of the rounds' mean times of each part in us, and the counts."""
    least_us: dict[str, float] = {}
    for _ in range(rounds):
        for part, spent_us in _round(scenario).items():
            least_us[part] = min(spent_us, least_us.get(part, spent_us))
    return least_us, counts_of(scenario)


def _round(scenario: Scenario) -> dict[str, float]:
    """Return the times of a tick in us: the whole, its parts, its arrivals, and a bare loop's."""
    patient = _patient(nodes := build_sides(scenario)[0])
    whole = _Watched(patient)
    _drive(scenario, nodes, whole, _Counting())
    patient = _patient(nodes := build_sides(scenario)[0])
    split = _Watched(patient)
    split.time_parts()
    _drive(scenario, nodes, split, _Counting())
    found = {_TICK: _median_us(whole.ticks, _TICK)}
    parts = sorted({part for tick in split.ticks for part in tick} - {_TICK, _RECEIVE})
    found |= {part: _median_us(split.ticks, part) for part in parts}
    found[_REST] = max(found[_TICK] - sum(found[part] for part in parts), 0.0)
    return found | {_RECEIVE: _median_us(whole.ticks, _RECEIVE), _BARE: _bare_us(scenario)}


def _bare_us(scenario: Scenario) -> float:
    """Return the time of a turn of the loop in us, of a node that does nothing at each tick."""
    idle = _Watched(_patient(nodes := build_sides(scenario)[0]))
    idle.inner = _Idle(idle.inner)  # type: ignore[assignment]
    _drive(scenario, nodes, idle, _Counting())
    return _median_us(idle.ticks, _TICK)


def _median_us(ticks: Sequence[Mapping[str, int]], part: str) -> float:
    settled = ticks[len(ticks) // 2 :]  # before that samples of the past are missing
    return median(tick.get(part, 0) for tick in settled) / NS_PER_US


def _patient(nodes: Mapping[Side, Node]) -> PatientNode:
    patient = nodes["patient"]
    assert isinstance(patient, PatientNode)
    return patient


def _drive(scenario: Scenario, nodes: dict[Side, Node], patient: _Watched, recorder: _Counting) -> None:
    """Run the twin with the watched patient in the place of its own; the other sides' records are not kept."""
    nodes["patient"] = patient
    logs: dict[Side, Recorder] = {side: _Counting() for side in nodes}
    drive(scenario, nodes, {**logs, "patient": recorder})
