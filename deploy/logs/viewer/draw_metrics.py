"""Ages and delays over time, for plots, and log lines: control requests, estimator faults, rejected messages."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand, Side
from tis.common.clocks import ClockModel
from tis.common.runtime.chunk_writer import Ints
from tis.common.units import NS_PER_MS
from tis.deploy.logs.payloads import json_row, json_rows
from tis.deploy.logs.viewer import foxglove
from tis.deploy.logs.viewer.drawn import AGE, DELAY, LOG, AgeSample, DelaySample, Drawn, EveryNth, Records, RunTopics

_NONE: Final = -1


class DelayStream:
    """The messages of one key that a side received, with their delays."""

    def __init__(self, key: str, direction: Direction, rate_hz: int) -> None:
        self._key, self._direction, self._pick = key, direction, EveryNth(rate_hz)

    def take(self, records: Records) -> Iterator[Drawn]:
        """Draw the next messages."""
        for i in self._pick.of(len(records.payloads)).tolist():
            log_ns = int(records.log_ns[i])
            delay_ms = (log_ns - int(records.publish_ns[i])) / NS_PER_MS
            sample = DelaySample(direction=self._direction, key=self._key, seq=int(records.seq[i]), delay_ms=delay_ms)
            yield Drawn(f"{DELAY}/{self._direction}", DelaySample, log_ns, sample.model_dump_json().encode())


class Freshest:
    """The freshest sample of each hand that a tick has used so far."""

    def __init__(self, topics: RunTopics, clock: ClockModel) -> None:
        self._clock = clock
        empty = np.full(1, _NONE, dtype=np.int64)
        self._used = dict.fromkeys(topics.hands, (empty, empty))

    def take(self, records: Records) -> Iterator[Drawn]:
        """Take the next notes of fresh samples; they are not drawn."""
        rows = [row for rows in json_rows(records.payloads) for row in rows]
        for hand, (ticks, samples_ns) in self._used.items():
            its_rows = [row for row in rows if row["hand"] == hand]
            if its_rows:
                taken_ns = np.array([row["sample_ns"] for row in its_rows], dtype=np.int64)
                # only the last known entry is needed before the new ones
                self._used[hand] = (
                    np.append(ticks[-1:], [row["tick"] for row in its_rows]),
                    np.append(samples_ns[-1:], self._clock.to_reference_ns(taken_ns)),
                )
        yield from ()

    def sample_ns(self, hand: Hand, tick: Ints) -> tuple[Ints, NDArray[np.bool_]]:
        """Return the aligned instant of the freshest sample at each ``tick`` (T,), and whether it is known (T,)."""
        ticks, samples_ns = self._used[hand]
        found = np.searchsorted(ticks, tick, side="right") - 1
        return samples_ns[found], (found >= 0) & (ticks[found] != _NONE)


class AgeStream:
    """The patient's ticks with the age at each of them."""

    def __init__(self, topics: RunTopics, clock: ClockModel, freshest: Freshest) -> None:
        self._topics, self._clock, self._freshest = topics, clock, freshest
        self._pick = EveryNth(topics.rate_hz)

    def take(self, records: Records) -> Iterator[Drawn]:
        """Draw the next ticks; missed ones and those before the first sample have no age."""
        chosen = self._pick.of(len(records.payloads))
        rows = [json_row(records.payloads[i]) for i in chosen.tolist()]
        begun = np.array([not row["missed"] for row in rows], dtype=np.bool_)
        tick, due_ns = (np.array([row[name] for row in rows], dtype=np.int64) for name in ("tick", "due_ns"))
        due_ns = self._clock.to_reference_ns(due_ns)
        for hand in self._topics.hands:
            sample_ns, known = self._freshest.sample_ns(hand, tick)
            known &= begun
            age_ms = (due_ns - sample_ns) / NS_PER_MS
            topic = self._topics.of_hand(AGE, hand)
            for at_ns, age in zip(records.log_ns[chosen][known].tolist(), age_ms[known].tolist(), strict=True):
                yield Drawn(topic, AgeSample, at_ns, AgeSample(age_ms=age).model_dump_json().encode())


_MAX_REJECTED: Final = 20


def line(at_ns: int, level: foxglove.Level, name: str, text: str) -> Drawn:
    """Return a line of the log as a message."""
    return Drawn(LOG, "log", at_ns, foxglove.log_line(at_ns, level, name, text))


class ControlStream:
    """Changes of the network."""

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield a line for each request, with the reason of a refusal."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            row = json_row(payload)
            text = f"{row['operation']} {row['request']}"
            if row["accepted"]:
                yield line(at_ns, "INFO", "netem", text)
            else:
                yield line(at_ns, "WARNING", "netem", f"refused ({row['reason']}): {text}")


class FaultStream:
    """The first failures of user-defined estimators."""

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield a line for each."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            row = json_row(payload)
            text = f"{row['estimator']} failed, {row['hand']} hand: {row['reason']}; further times are counted"
            yield line(at_ns, "WARNING", "patient", text)


class RejectedStream:
    """Messages that a side rejected, the first ones only."""

    def __init__(self, side: Side) -> None:
        self._side, self._n_seen = side, 0

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield a line for each of the first messages."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            self._n_seen += 1
            if self._n_seen <= _MAX_REJECTED:
                row = json_row(payload)
                last = "; further ones are not listed here" if self._n_seen == _MAX_REJECTED else ""
                yield line(at_ns, "WARNING", self._side, f"rejected on {row['key']}: {row['reason']}{last}")
