"""One-way delay: distributions, the sum of delay and jitter, and the blocks of draws."""

from netem.stages.delay.blocks import delay_blocks
from netem.stages.delay.build import latency_of
from netem.stages.delay.latency import LatencyModel
from netem.stages.delay.law import Delay

__all__ = ["Delay", "LatencyModel", "delay_blocks", "latency_of"]
