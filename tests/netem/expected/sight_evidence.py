"""Evidence of sight: theory of frames and of a shared rate against netem's own draws and queues.

`python -m tests.netem.expected.sight_evidence` prints three tables. `frames`: shares of lost and decodable frames of
10 000 with 99 % limits by a bootstrap over groups of pictures. `coverage`: how often such limits hold theory, over 40
seeds. `rate`: the longest wait of a force behind video. A name prints that table alone. All take half a minute.
"""

import sys
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from tests.netem.making import link, offer, packet
from tis.common.scenario.network import NetworkPart
from tis.netem.expected.frames import frame_shares, transmission_ns
from tis.netem.expected.simulate import simulate

N_FRAMES: Final = 10_000
N_RESAMPLED: Final = 4000
FRAME_NS: Final = 10**9 // 30
VIDEO: Final = "tis/ECM/video"
FORCE: Final = "tis/PSM2/measured_cf"

Part = dict[str, Any]
IID: Final[list[Part]] = [{"kind": "bernoulli", "p_loss": p} for p in (0.001, 0.005, 0.02)]
BURSTS: Final[list[Part]] = [
    {"kind": "gilbert_elliott", "p_bad": 0.002, "p_good": 0.3, "p_loss_bad": 0.8, "p_loss_good": 0.0005},
    {"kind": "gilbert_elliott", "p_bad": 0.01, "p_good": 0.5, "p_loss_bad": 1.0, "p_loss_good": 0.0},
    {"kind": "gilbert_elliott", "p_bad": 0.0005, "p_good": 0.02, "p_loss_bad": 0.5, "p_loss_good": 0.0},
]
STREAMS: Final = {"equal": (7, 7, 30), "unequal": (19, 1, 30), "no key frames": (7, 7, 1)}
"""Packets of a key frame and of another one, and frames from one key frame to the next."""


class Judged(NamedTuple):
    """A share measured, its 99 % limits, and what theory has for it."""

    found: float
    low: float
    high: float
    theory: float

    @property
    def holds(self) -> bool:
        """Tell whether theory lies within the limits."""
        return self.low <= self.theory <= self.high


def frames(loss: Part, stream: str, n_frames: int = N_FRAMES, seed: int = 11) -> tuple[Judged, Judged]:
    """Return the shares of lost and of decodable frames that netem's draws make."""
    n_key, n_other, every = STREAMS[stream]
    is_key = np.arange(n_frames) % every == 0
    n_packets = np.where(is_key, n_key, n_other)
    first = np.concatenate([[0], np.cumsum(n_packets)[:-1]])
    network = NetworkPart.model_validate({"feedback": {"loss": loss}})
    offered_ns = np.repeat(np.arange(n_frames, dtype=np.int64) * FRAME_NS, n_packets)
    lost = np.add.reduceat(simulate(network, "feedback", seed, offered_ns, key=VIDEO).lost.astype(int), first) > 0
    broken = 0
    decodable = np.zeros(n_frames, dtype=bool)
    for frame, gone in enumerate(lost.tolist()):  # the definition, frame by frame
        broken = gone if is_key[frame] else broken or gone
        decodable[frame] = not broken
    theory = frame_shares(network.feedback.loss, [n_key] + [n_other] * (every - 1), [True] + [False] * (every - 1))
    every = max(every, 30)  # where each frame is a key frame, bursts join them
    return judged(lost, every, theory.lost, seed), judged(decodable, every, theory.decodable, seed)


def judged(values: np.ndarray, every: int, theory: float, seed: int) -> Judged:
    """Return the share of true values with its limits, by resampling blocks of four groups of pictures."""
    blocks = values[: len(values) // (4 * every) * 4 * every].reshape(-1, 4 * every).mean(axis=1)
    drawn = np.random.default_rng(seed).integers(0, len(blocks), (N_RESAMPLED, len(blocks)))
    low, high = np.quantile(blocks[drawn].mean(axis=1), (0.005, 0.995))
    return Judged(float(values.mean()), float(low), float(high), theory)


def frame_table() -> Iterator[str]:
    """Yield a line for each loss and stream."""
    for loss in (*IID, *BURSTS):
        for stream in STREAMS:
            words = " ".join(f"{value}" for value in loss.values())
            both = zip(("lost", "decodable"), frames(loss, stream), strict=True)
            text = "  ".join(
                f"{name} {of.found:.4f} in {of.low:.4f} to {of.high:.4f}, theory {of.theory:.4f}"
                f"{'' if of.holds else ' NOT'}"
                for name, of in both
            )
            yield f"{words:44} {stream:13} {text}"


def coverage_table(n_seeds: int = 40) -> Iterator[str]:
    """Yield how many limits do not hold theory, and how far the mean of all seeds is from it."""
    n_missed, n_all = 0, 0
    for loss in (*IID, *BURSTS):
        for stream in STREAMS:
            each = [frames(loss, stream, seed=seed) for seed in range(n_seeds)]
            missed = sum(not of.holds for both in each for of in both)
            n_missed, n_all = n_missed + missed, n_all + 2 * n_seeds
            off = []
            for column in zip(*each, strict=True):
                found = np.array([of.found for of in column])
                off.append((found.mean() - column[0].theory) / (found.std() / n_seeds**0.5))
            words = " ".join(f"{value}" for value in loss.values())
            ends = f"missed {missed:2} of {2 * n_seeds}, means off by {off[0]:+.1f} {off[1]:+.1f} sd"
            yield f"{words:44} {stream:13} {ends}"
    yield f"{n_missed} of {n_all} limits missed theory: {100 * n_missed / n_all:.1f} %, 1 % expected"


class Waited(NamedTuple):
    """The longest time of a force from offering to leaving, and what theory has for it; in ns."""

    longest_ns: int
    theory_ns: int


def waited(n_bytes: int, fragment: int, kbit_s: float, apart: bool, overhead: int = 0, n_frames: int = 300) -> Waited:
    """Offer forces at 500 Hz and frames at 30 fps to one rate, or to two that keys rule apart."""
    rate = {"kbit_s": kbit_s, "overhead_bytes": overhead}
    rules = [{"key": FORCE, "direction": "feedback", "pipeline": {"rate": rate}}] if apart else []
    made = link("feedback", feedback={"rate": rate}, rules=rules)
    pieces = [min(fragment, n_bytes - at) for at in range(0, n_bytes, fragment)]
    # the period of the forces has no common measure with that of frames, so all phases occur
    period_ns, n_force = 1_997_137, 200
    offers = [(k * period_ns, 1, FORCE, n_force) for k in range(n_frames * FRAME_NS // period_ns)]
    offers += [(k * FRAME_NS, 0, VIDEO, n) for k in range(n_frames) for n in pieces]
    header, longest = 0, 0
    seq = {FORCE: 0, VIDEO: 0}

    def take(until_ns: int) -> None:
        nonlocal longest
        while (due_ns := made.next_release_ns()) is not None and due_ns <= until_ns:
            for left in made.release(due_ns):
                if left.flow.name == FORCE:
                    longest = max(longest, left.queued_ns)
                made.left(left, due_ns)

    for at_ns, _, key, n in sorted(offers, key=lambda one: one[:2]):
        take(at_ns)
        message = packet(at_ns, seq[key], key, bytes(n))
        seq[key] += 1
        header = len(message.attachment)
        offer(made, message, at_ns)
    take(10**15)
    own = transmission_ns(n_force + header, 1, kbit_s, overhead)
    video = transmission_ns(n_bytes + len(pieces) * header, len(pieces), kbit_s, overhead)
    return Waited(longest - own, 0 if apart else video)


def rate_table() -> Iterator[str]:
    """Yield a line for each frame, rate and rule."""
    for n_bytes in (22_100, 8300):
        for overhead in (0, 46):
            for apart in (False, True):
                found = waited(n_bytes, 1200, 10_000, apart, overhead)
                theory_ms = found.theory_ns / 1e6
                error = f"{100 * (found.longest_ns / found.theory_ns - 1):+.2f} %" if found.theory_ns else ""
                yield (
                    f"{n_bytes} bytes, overhead {overhead:2}, 10 Mbit/s, {'apart' if apart else 'one rate':8}  "
                    f"longest wait {found.longest_ns / 1e6:7.3f} ms  theory {theory_ms:7.3f} ms  {error}"
                )


def main() -> None:
    """Print the tables that are asked for."""
    tables: dict[str, Callable[[], Iterator[str]]] = {
        "frames": frame_table, "coverage": coverage_table, "rate": rate_table,
    }  # fmt: skip
    for name in sys.argv[1:2] or tables:
        for line in tables[name]():
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
