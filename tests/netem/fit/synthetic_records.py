"""Synthetic records by numpy alone, of processes that the emulator's models do not share code with."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import lfilter

from tis.common.trace import LOST, Trace


@dataclass(frozen=True)
class Parameters:
    """The process behind a record; times in s, delays in ms."""

    seconds: float = 600.0
    rate_hz: float = 100.0
    shift: float = 20.0
    mean: float = 10.0
    sd: float = 5.0
    half_life: float = 0.3
    p_loss: float = 0.01
    burst: float = 4.0
    gap: float = 40.0
    outage: float = 1.0
    good: float = 20.0
    bad: float = 2.0
    p_bad: float = 0.5
    bad_delay: float = 15.0
    cycle: float = 15.0
    stall: float = 0.25
    stall_spread: float = 0.3
    step: float = 15.0
    step_ms: float = 30.0
    line_mbit_s: float = 10.0
    buffer_ms: float = 300.0
    others_mbit_s: float = 14.0
    others_on: float = 4.0
    others_off: float = 8.0


def _delays(of: Parameters, rng: np.random.Generator, n: int) -> np.ndarray:
    """A lognormal part over a shift, by an autoregression of the logarithms."""
    rho = 2.0 ** (-1 / (of.rate_hz * of.half_life))
    steps = rng.normal(size=n) * np.sqrt(1 - rho**2)
    steps[0] /= np.sqrt(1 - rho**2)
    z = lfilter([1], [1, -rho], steps)
    variance = np.log1p((of.sd / of.mean) ** 2)
    return np.asarray(of.shift + np.exp(np.log(of.mean) - variance / 2 + np.sqrt(variance) * z))


def _bursts(of: Parameters, rng: np.random.Generator, n: int) -> np.ndarray:
    lost = np.zeros(n, dtype=bool)
    at = 0
    while of.p_loss > 0 and at < n:
        at += rng.geometric(of.p_loss / (1 - of.p_loss) / of.burst)
        length = rng.geometric(1 / of.burst)
        lost[at : at + length] = True
        at += length
    return lost


def _alternating(rng: np.random.Generator, seconds: float, up: float, down: float) -> list[tuple[float, float]]:
    found, at = [], rng.exponential(up)
    while at < seconds:
        length = rng.exponential(down)
        found.append((at, at + length))
        at += length + rng.exponential(up)
    return found


def _within(sent: np.ndarray, spans: list[tuple[float, float]]) -> np.ndarray:
    within = np.zeros(len(sent), dtype=bool)
    for begin, end in spans:
        within |= (sent >= begin) & (sent < end)
    return within


def correlated(of: Parameters, rng: np.random.Generator, sent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Correlated lognormal delays with bursts of losses."""
    return _delays(of, rng, len(sent)), _bursts(of, rng, len(sent))


def with_outages(of: Parameters, rng: np.random.Generator, sent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same with outages."""
    delay, lost = correlated(of, rng, sent)
    return delay, lost | _within(sent, _alternating(rng, of.seconds, of.gap, of.outage))


def bad_states(of: Parameters, rng: np.random.Generator, sent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States in which a part is lost and the rest takes longer."""
    delay = _delays(of, rng, len(sent))
    bad = _within(sent, _alternating(rng, of.seconds, of.good, of.bad))
    return delay + of.bad_delay * bad, rng.random(len(sent)) < np.where(bad, of.p_bad, of.p_loss / 10)


def stalls(of: Parameters, rng: np.random.Generator, sent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A cycle: at its end nothing leaves for a while, then all that waits leaves at once."""
    delay = _delays(of, rng, len(sent))
    leaves = sent.copy()
    at = of.cycle * rng.random()
    while at < of.seconds:
        end = at + of.stall * (1 + of.stall_spread * (2 * rng.random() - 1))
        leaves = np.where((sent >= at) & (sent < end), end, leaves)
        at += of.cycle
    return delay + 1000 * (leaves - sent), rng.random(len(sent)) < of.p_loss / 4


def steps(of: Parameters, rng: np.random.Generator, sent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A satellite: every few seconds, at a fixed period, another path with another delay."""
    delay, lost = correlated(of, rng, sent)
    number = ((sent + of.step * rng.random()) // of.step).astype(np.int64)
    return delay + of.step_ms * rng.random(number.max() + 1)[number], lost


def bufferbloat(of: Parameters, rng: np.random.Generator, sent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A line with a long buffer, which others fill now and then: a fluid queue by Lindley's recursion, each ms."""
    n = int(of.seconds * 1000)
    busy = _within(np.arange(n) / 1000, _alternating(rng, of.seconds, of.others_off, of.others_on))
    wait = np.zeros(n + 1)
    for k, load in enumerate(np.where(busy, of.others_mbit_s / of.line_mbit_s, 0.0).tolist()):
        wait[k + 1] = min(max(wait[k] + load - 1.0, 0.0), of.buffer_ms)
    delay = of.shift + 0.3 * _delays(of, rng, len(sent))
    full = wait[np.minimum((sent * 1000).astype(np.int64), n)]
    return delay + full, rng.random(len(sent)) < np.where(full >= of.buffer_ms, 0.02, 0.0)


Make = Callable[[Parameters, np.random.Generator, np.ndarray], tuple[np.ndarray, np.ndarray]]
RECORDS: Final[dict[str, Make]] = {
    "bursts": correlated,
    "outages": with_outages,
    "bad_states": bad_states,
    "stalls": stalls,
    "steps": steps,
    "bufferbloat": bufferbloat,
}


def record(name: str, of: Parameters, seed: int, in_order: bool = True) -> Trace:
    """Return a record; ``in_order``: no message overtakes another."""
    rng = np.random.default_rng(seed)
    sent = np.arange(int(of.seconds * of.rate_hz)) / of.rate_hz
    delay, lost = RECORDS[name](of, rng, sent)
    if in_order:
        arrives = np.maximum.accumulate(np.where(lost, 0.0, sent + delay / 1000))
        delay = np.where(lost, delay, 1000 * (arrives - sent))
    sent_ns = np.rint(sent * 1e9).astype(np.int64)
    return Trace(name, sent_ns, np.where(lost, LOST, np.rint(delay * 1e6)).astype(np.int64))
