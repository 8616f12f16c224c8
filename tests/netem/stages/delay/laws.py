"""Delays as a scenario has them, each beside the same distribution by scipy.stats, in ms."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tis.common.scenario.network.pipeline import Pipeline
from tis.common.streams import BLOCK, Address
from tis.netem.stages.delay import LatencyModel, delay_blocks, latency_of

MS = 1e6
ADDRESS = Address(11, "forward", "tis/MTML/measured_cp")


class Law(NamedTuple):
    """A law that is redrawn above ``max_ms``, by its untruncated distribution function in ms."""

    part: dict[str, Any]
    whole: Any
    max_ms: float = 3.6e6

    def cdf(self, delay_ms: Any) -> Any:
        return np.minimum(self.whole.cdf(delay_ms) / self.whole.cdf(self.max_ms), 1.0)


class Mixture(NamedTuple):
    weights: tuple[float, ...]
    laws: tuple[Any, ...]

    def cdf(self, x: Any) -> Any:
        return sum(w * law.cdf(x) for w, law in zip(self.weights, self.laws, strict=True))

    def pdf(self, x: Any) -> Any:
        return sum(w * law.pdf(x) for w, law in zip(self.weights, self.laws, strict=True))


def _lognormal(mean: float, std: float, shift: float = 0.0) -> Any:
    variance = np.log(1 + (std / mean) ** 2)
    return stats.lognorm(np.sqrt(variance), loc=shift, scale=mean * np.exp(-variance / 2))


def _gamma(mean: float, std: float, shift: float = 0.0) -> Any:
    return stats.gamma((mean / std) ** 2, loc=shift, scale=std**2 / mean)


POINTS = [(0, 4), (0.25, 5), (0.5, 5.5), (0.95, 9), (1, 40)]

LAWS = {
    "uniform": Law({"kind": "uniform", "low_ms": 10, "high_ms": 30}, stats.uniform(10, 20)),
    "normal": Law({"kind": "normal", "mean_ms": 20, "std_ms": 2}, stats.norm(20, 2)),
    "truncated normal": Law({"kind": "normal", "mean_ms": 1, "std_ms": 3}, stats.truncnorm(-1 / 3, np.inf, 1, 3)),
    "lognormal": Law({"kind": "lognormal", "mean_ms": 5, "std_ms": 3, "shift_ms": 10}, _lognormal(5, 3, 10)),
    "redrawn lognormal": Law({"kind": "lognormal", "mean_ms": 5, "std_ms": 20, "max_ms": 30}, _lognormal(5, 20), 30),
    "gamma": Law({"kind": "gamma", "mean_ms": 6, "std_ms": 4}, _gamma(6, 4)),
    "exponential": Law({"kind": "gamma", "mean_ms": 6, "std_ms": 6, "shift_ms": 1}, stats.expon(1, 6)),
    "redrawn gamma": Law(
        {"kind": "gamma", "mean_ms": 5, "std_ms": 6, "shift_ms": 2, "max_ms": 12}, _gamma(5, 6, 2), 12
    ),
    "pareto": Law({"kind": "pareto", "scale_ms": 40, "shape": 9, "shift_ms": 3}, stats.lomax(9, 3, 40)),
    "endless pareto": Law(
        {"kind": "pareto", "scale_ms": 2, "shape": 0.4, "max_ms": 500}, stats.lomax(0.4, 0, 2), 500
    ),
    "pareto without variance": Law(
        {"kind": "pareto", "scale_ms": 10, "shape": 2, "max_ms": 200}, stats.lomax(2, 0, 10), 200
    ),
    "pareto without mean": Law(
        {"kind": "pareto", "scale_ms": 10, "shape": 1, "max_ms": 60}, stats.lomax(1, 0, 10), 60
    ),
    "hyperexponential": Law(
        {"kind": "hyperexponential", "weights": [0.8, 0.2], "means_ms": [10, 150], "shift_ms": 15},
        Mixture((0.8, 0.2), (stats.expon(15, 10), stats.expon(15, 150))),
    ),
    "redrawn hyperexponential": Law(
        {"kind": "hyperexponential", "weights": [0.5, 0.3, 0.2], "means_ms": [1, 10, 200], "max_ms": 80},
        Mixture((0.5, 0.3, 0.2), (stats.expon(0, 1), stats.expon(0, 10), stats.expon(0, 200))),
        80,
    ),
    "quantiles": Law(
        {"kind": "quantiles", "points": [{"p": p, "delay_ms": d} for p, d in POINTS]},
        Mixture(
            (0.25, 0.25, 0.45, 0.05),
            (stats.uniform(4, 1), stats.uniform(5, 0.5), stats.uniform(5.5, 3.5), stats.uniform(9, 31)),
        ),
    ),
}


def stages(delay: dict[str, Any], **others: Any) -> Pipeline:
    return Pipeline.model_validate({"delay": delay, **others})


def model(delay: dict[str, Any], **others: Any) -> LatencyModel:
    return latency_of(stages(delay, **others), {})


def drawn(pipeline: Pipeline, n: int, address: Address = ADDRESS) -> NDArray[np.int64]:
    blocks = delay_blocks(pipeline, address, {})
    return np.concatenate([blocks.block(number) for number in range(-(-n // BLOCK))])[:n]
