"""One-way delay: distributions, the sum of delay and jitter, and the blocks of draws."""

from tis.netem.stages.delay.blocks import delay_blocks, latency_of
from tis.netem.stages.delay.latency import LatencyModel
from tis.netem.stages.delay.laws import Delay

__all__ = ["Delay", "LatencyModel", "delay_blocks", "latency_of"]
