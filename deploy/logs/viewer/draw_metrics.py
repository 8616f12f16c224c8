"""Ages and delays over time, for plots, and log lines: control requests, estimator faults, rejected messages."""

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand, Side
from tis.common.clocks import ClockModel
from tis.common.messages import encode
from tis.common.runtime.chunk_writer import Ints
from tis.common.units import NS_PER_MS
from tis.deploy.logs.payloads import Row, json_row, json_rows
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
            yield Drawn(f"{DELAY}/{self._direction}", DelaySample, log_ns, encode(sample))


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
                yield Drawn(topic, AgeSample, at_ns, encode(AgeSample(age_ms=age)))


def line(at_ns: int, level: foxglove.Level, name: str, text: str) -> Drawn:
    """Return a line of the log as a message."""
    return Drawn(LOG, "log", at_ns, foxglove.log_line(at_ns, level, name, text))


class LineStream:
    """Records of a side as lines of the log, the first ``most`` only."""

    def __init__(
        self, side: Side, text: Callable[[Row], tuple[foxglove.Level, str]], most: int | None = None
    ) -> None:
        self._side, self._text, self._most, self._n_seen = side, text, most, 0

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield a line for each record."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            self._n_seen += 1
            if self._most is None or self._n_seen <= self._most:
                level, text = self._text(json_row(payload))
                last = "; further ones are not listed here" if self._n_seen == self._most else ""
                yield line(at_ns, level, self._side, f"{text}{last}")


def control_line(row: Row) -> tuple[foxglove.Level, str]:
    """Return level and text of a request to change the network, with the reason of a refusal."""
    text = f"{row['operation']} {row['request']}"
    return ("INFO", text) if row["accepted"] else ("WARNING", f"refused ({row['reason']}): {text}")


def fault_line(row: Row) -> tuple[foxglove.Level, str]:
    """Return level and text of the first failure of a user-defined estimator."""
    return "WARNING", f"{row['estimator']} failed, {row['hand']} hand: {row['reason']}; further times are counted"


def rejected_line(row: Row) -> tuple[foxglove.Level, str]:
    """Return level and text of a rejected message."""
    return "WARNING", f"rejected on {row['key']}: {row['reason']}"
