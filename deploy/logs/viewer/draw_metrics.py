"""Ages and delays over time, for plots."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand
from tis.common.clocks import ClockModel
from tis.common.runtime.chunk_writer import Ints
from tis.common.units import NS_PER_MS
from tis.deploy.logs.json_rows import json_row, json_rows
from tis.deploy.logs.topics import AGE, DELAY, RunTopics
from tis.deploy.logs.viewer.derived_records import AgeSample, DelaySample
from tis.deploy.logs.viewer.drawn import Drawn, EveryNth, Records

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
