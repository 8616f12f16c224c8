"""Frames of a picture behind a network, in theory: how many arrive, how many decode, and who waits behind them.

A frame is sent as consecutive packets of one key. It arrives when all of them do, and it decodes when it and all
frames from its key frame on arrive. So each is the survival of some packets in a row, which the loss models know
exactly (`tis.netem.stages.loss.expected_loss`), bursts included: for independent losses of p it is (1 - p) ** n, for
Gilbert and Elliott's model pi D (A D) ** (n - 1) 1, D = diag(1 - e).
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from tis.common.scenario.network.loss import Loss
from tis.common.units import NS_PER_S
from tis.netem.stages.loss import expected_loss

_BITS: Final = 8


class FrameShares(NamedTuple):
    """Shares of frames, in the long run: ``lost``, not all packets arrive; ``decodable``, with its reference."""

    lost: float
    decodable: float


def frame_shares(loss: Loss | None, n_packets: Sequence[int], key_frames: Sequence[bool]) -> FrameShares:
    """Return the expected shares of lost and decodable frames.

    Parameters
    ----------
    loss
        Loss of the packets; a recorded one has no theory (`ValueError`).
    n_packets, key_frames
        (N,) the packets of each frame, >= 1, in the order of sending, and which ones are key frames, the first one
        included. One period of a stream that repeats itself is enough.

    Notes
    -----
    With n_I packets in a key frame, n_P in each other and a key frame every N, the decodable share is the mean over
    j < N of the survival of n_I + j n_P packets. Equal fragments and independent losses, a frame lost with
    probability q: (1 - q) (1 - (1 - q) ** N) / (N q). Oracles: the closed forms and netem's own draws,
    tests/netem/expected/test_frames.
    """
    if loss is not None and loss.kind == "trace":
        raise ValueError("a recorded loss has no expected share of frames")
    if not n_packets or not key_frames[0]:
        raise ValueError("frames must begin with a key frame")
    lost, decodable, needed = 0.0, 0.0, 0
    known: dict[int, float] = {}

    def loss_of(n: int) -> float:
        if n not in known:
            known[n] = expected_loss(loss, {}, n).p_loss
        return known[n]

    for n, is_key in zip(n_packets, key_frames, strict=True):
        needed = n if is_key else needed + n
        lost += loss_of(n)
        decodable += 1.0 - loss_of(needed)
    return FrameShares(lost / len(n_packets), decodable / len(n_packets))


def transmission_ns(n_bytes: int, n_packets: int, kbit_s: float, overhead_bytes: int = 0) -> int:
    """Return how long a frame of ``n_bytes`` in ``n_packets`` occupies a rate, 8 (bytes + n overhead) / rate, in ns.

    A message that shares the rate waits at most so long behind the frame, and its own transmission comes on top.
    Oracle: the waits of a link, tests/netem/expected/test_frames.
    """
    return round(_BITS * (n_bytes + n_packets * overhead_bytes) * NS_PER_S / (1000.0 * kbit_s))
