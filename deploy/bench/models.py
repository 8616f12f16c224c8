"""Page of ``tis bench models``: statistics of the emulator's models, beside tc-netem's published algorithm."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray
from rich.console import Console

from tis.common.metrics.loss import fit_gilbert
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.streams import Stream
from tis.common.units import NS_PER_MS
from tis.deploy.present.table import Table
from tis.netem.expected.simulate import Simulated, simulate
from tis.netem.stages.delay import latency_of
from tis.netem.stages.loss import expected_loss

# Correlated jitter and loss of Linux tc-netem, for comparison: written from its published description.
#
# The manual page tc-netem(8) (S. Hemminger, "Network emulation with NetEm", 2005) defines each random number as rho
# times the last one plus 1 - rho times a fresh one. Such a mixture of uniforms is not uniform: it is rarely near 0,
# so the loss, which compares it with a threshold, is far below the requested one. The jitter uses the number's
# remainder (the kernel's function tabledist), which wraps around many times, so it is uniform and has no
# correlation left.

Floats = NDArray[np.float64]


def correlated_uniforms(u: Floats, rho: float) -> Floats:
    """Return x_n = (1 - rho) u_n + rho x_(n-1) for uniforms (N,) in [0, 1) and rho in [0, 1); x_0 is u_0.

    Oracle: the variance (1 - rho) / (1 + rho) / 12 of a stationary autoregression.
    """
    if len(u) < 2:
        return u
    x, _ = scipy.signal.lfilter([1.0 - rho], [1.0, -rho], u[1:], zi=[rho * u[0]])
    return np.concatenate([u[:1], x])


def jitter(delay_ns: int, jitter_ns: int, x: Floats) -> NDArray[np.int64]:
    """Return delays in ns, (N,), for ``delay DELAY JITTER RHO`` without a table, from correlated x in [0, 1).

    The 32-bit number modulo twice the jitter, as the kernel reduces it; a jitter above 2 s would not wrap.
    """
    return np.floor(x * 2.0**32).astype(np.int64) % (2 * jitter_ns) - jitter_ns + delay_ns


def loss_with_correlation(n: int, p: float, rho: float, u: Floats) -> NDArray[np.bool_]:
    """Return which of ``n`` packets tc-netem loses for ``loss p rho``, (n,): those whose number is below ``p``.

    ``p`` and ``rho`` in 0..1. ``u`` are n + 1 uniforms in (0, 1); the recursion begins with the first. tc-netem
    computes x_i = ((2**32 - rho) u_i + rho x_{i-1}) / 2**32 in 32-bit fractions; here in real numbers (oracle:
    a loop in integers, tests/deploy/bench/test_tc_netem).
    """
    if len(u) != n + 1:
        raise ValueError(f"u must have n + 1 = {n + 1} numbers (got {len(u)})")
    return correlated_uniforms(u, rho)[1:] < p


_SEED: Final = 7
_N: Final = 1_000_000
_GAP_NS: Final = NS_PER_MS

_DELAYS: Final[dict[str, dict[str, Any]]] = {
    "constant 40 ms": {"delay": {"kind": "constant", "delay_ms": 40}},
    "uniform 20-60 ms": {"delay": {"kind": "uniform", "low_ms": 20, "high_ms": 60}},
    "normal 10 +- 1 ms": {"delay": {"kind": "normal", "mean_ms": 10, "std_ms": 1}},
    "normal 2 +- 5 ms, redrawn above 0": {"delay": {"kind": "normal", "mean_ms": 2, "std_ms": 5}},
    "lognormal 20 +- 10 ms": {"delay": {"kind": "lognormal", "mean_ms": 20, "std_ms": 10}},
    "gamma 20 +- 5 ms, shifted by 5": {"delay": {"kind": "gamma", "mean_ms": 20, "std_ms": 5, "shift_ms": 5}},
    "Pareto, scale 10 ms, shape 5": {"delay": {"kind": "pareto", "scale_ms": 10, "shape": 5}},
    "hyperexponential, NetFI's first": {
        "delay": {
            "kind": "hyperexponential",
            "weights": [0.72645, 0.27355],
            "means_ms": [1 / 0.02711, 1 / 0.08529],
            "shift_ms": 70,
        }
    },
    "10 ms, jitter normal 1 ms": {
        "delay": {"kind": "constant", "delay_ms": 10},
        "jitter": {"kind": "normal", "std_ms": 1},
    },
    "10 ms, jitter normal 1 ms, half-life 50 ms": {
        "delay": {"kind": "constant", "delay_ms": 10},
        "jitter": {"kind": "normal", "std_ms": 1},
        "correlation": {"half_life_s": 0.05},
    },
}
_LOSSES: Final[dict[str, dict[str, Any]]] = {
    "1 %, independent": {"kind": "bernoulli", "p_loss": 0.01},
    "1 %, bursts of 3": {"kind": "burst", "p_loss": 0.01, "mean_burst": 3},
    "5 %, bursts of 8": {"kind": "burst", "p_loss": 0.05, "mean_burst": 8},
    "Gilbert-Elliott p .02 r .25, half lost in bad": {
        "kind": "gilbert_elliott",
        "p_bad": 0.02,
        "p_good": 0.25,
        "p_loss_bad": 0.5,
    },
    "4 states, p13 .01 p31 .3 p32 .2 p23 .5 p14 .005": {
        "kind": "four_state",
        "p13": 0.01,
        "p31": 0.3,
        "p32": 0.2,
        "p23": 0.5,
        "p14": 0.005,
    },
}
_TC_LOSSES: Final = ((0.003, 0.25), (0.01, 0.25), (0.05, 0.25), (0.05, 0.0))


def write_models_page(file: Path, out: Console) -> None:
    """Draw a million packets from each model and write the page."""
    text = "\n".join(
        [_HEAD, _delay_table(), _CORRELATION, _jitter_table(), _LOSS, loss_table(), _TC, tc_table(), _NAMES]
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    out.print(f"{file}: {_N:,} packets a row, seed {_SEED}")


_HEAD: Final = f"""# What the emulator's models draw

Made by `tis bench models`; no figure here is typed by hand. Each row is {_N:,} packets of the very draws that the
live emulator makes (`tis.netem.expected.simulate`), one a millisecond, seed {_SEED}. *Asked* is computed from the
model, in closed
form or by quadrature. The tests (`tests/netem/stages/delay`, `tests/netem/stages/loss`) hold every model to its
distribution by Kolmogorov-Smirnov or chi-square tests; this page is for people.

## Delay, in ms
"""
_CORRELATION: Final = """
## Jitter that hangs together

A network's delay does not jump from message to message. tc-netem offers a correlation per cent from packet to packet:
each random number is mixed with the one before. Its kernel then takes the mixed 32-bit number modulo twice the jitter
in ns. The number wraps around many times, so the spread is the one asked for, and no correlation is left. Here the
correlation is a half-life in seconds (a Gaussian-copula Ornstein-Uhlenbeck process), and the distribution stays what
it was. *Neighbours* is the correlation of each delay with the one before. *Overtaken* are messages that a later one
would overtake if the order were not kept.
"""
_LOSS: Final = """
## Loss

*Burst* is the mean number of messages in a run of losses. The interval is for 95 %, widened for bursts.
"""
_TC: Final = """
## Loss as tc-netem's published algorithm draws it

Mixing makes small numbers rare, and a packet is lost when its number is small: most of the loss that was
asked for does not happen. Our column asks for the same share, in bursts that a packet-to-packet correlation of
that size would give (1 / (1 - p) / (1 - rho) messages).
"""
_NAMES: Final = """
## Names that come and go

Each name (a key, a token, a query's question, replies and end) has numbers of its own. A link keeps the state of a
name while it is used, and closes it when another name is opened and nothing of it has moved for 20 s, or at once
beyond 20 000 names. A name that holds messages stays open.

- **Nobody's fates change.** A draw is addressed by seed, direction, name, stage and sequence number, or millisecond
  of run time. So what a name draws does not depend on which others are open, and a closed name is built again as it
  was.
- **A name that returns goes on where it was.** The number of its next message is kept, for 400 000 closed names in a
  direction, in 8 MB. So the fates of a run are the same with and without closing, and those of its replay.
- **Beyond that** all of these numbers are forgotten together. From then on a name without a known number begins above
  the greatest one forgotten: it draws what no message of this name has drawn. Its fates are those of a replay, but no
  longer those of a run in which fewer names came before it. netem warns from 320 000 on.
- **Little is drawn for a name's first packets**: 64 numbers a stage, which are the beginning of the block of 4096,
  bit for bit. A network without delay draws none.

The oracle is a link that closes nothing (`tests/netem/link/test_flows`).
"""


def _simulated(pipeline: dict[str, Any], gap_ns: int = _GAP_NS) -> Simulated:
    network = NetworkPart.model_validate({"forward": pipeline})
    return simulate(network, "forward", _SEED, np.arange(_N, dtype=np.int64) * gap_ns)


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return Table("", heads, rows).markdown()


def _delay_table() -> str:
    rows = []
    for name, pipeline in _DELAYS.items():
        model = latency_of(Pipeline.model_validate(pipeline), {})
        drawn_ms = _simulated(pipeline).delay_ns / NS_PER_MS
        asked = [model.mean_ns, model.std_ns, *model.quantiles_ns([0.5, 0.99, 0.999])]
        came = [drawn_ms.mean(), drawn_ms.std(), *np.percentile(drawn_ms, [50, 99, 99.9])]
        rows.append([name, *(f"{a / NS_PER_MS:.3f} / {c:.3f}" for a, c in zip(asked, came, strict=True))])
    return _markdown(["asked / drawn", "mean", "sd", "p50", "p99", "p99.9"], rows)


def _jitter_table() -> str:
    u = Stream.named(_SEED, "tc").uniforms(0, _N)
    rows = []
    uniform = {"delay": {"kind": "constant", "delay_ms": 10}, "jitter": {"kind": "uniform", "half_width_ms": 1}}
    wanted = 1 / np.sqrt(3)
    for rho in (0.0, 0.25, 0.5):
        tc_ms = jitter(10 * NS_PER_MS, NS_PER_MS, correlated_uniforms(u, rho)) / NS_PER_MS
        half_life_s = 0.001 * np.log(0.5) / np.log(rho) if rho else None
        pipeline: dict[str, Any] = dict(uniform)
        if half_life_s is not None:
            pipeline["correlation"] = {"half_life_s": max(0.001, half_life_s)}
        ours_ms = _simulated(pipeline).delay_ns / NS_PER_MS
        about = f"half-life {max(0.001, half_life_s) * 1e3:.1f} ms" if half_life_s else "independent"
        rows.append(
            [
                f"10 +- 1 ms uniform at 1 kHz, {100 * rho:.0f} %",
                f"{tc_ms.std() / wanted:.3f} of what was asked",
                f"{_neighbours(tc_ms):.2f}",
                f"{ours_ms.std() / wanted:.3f} ({about})",
                f"{_neighbours(ours_ms):.2f}",
                f"{_overtaken(tc_ms):.1f} %",
                f"{_overtaken(ours_ms):.1f} %",
            ]
        )
    slow = uniform | {"correlation": {"half_life_s": 0.05}}
    ours_ms = _simulated(slow).delay_ns / NS_PER_MS
    row = [
        "the same with a half-life of 50 ms",
        "-",
        "-",
        f"{ours_ms.std() / wanted:.3f}",
        f"{_neighbours(ours_ms):.2f}",
        "-",
        f"{_overtaken(ours_ms):.1f} %",
    ]
    head = ["asked", "sd, tc-netem's algorithm", "neighbours, tc-netem's", "sd, here", "neighbours, here"]
    return _markdown([*head, "overtaken, tc-netem's", "overtaken, here"], [*rows, row])


def _neighbours(delays_ms: NDArray[np.float64]) -> float:
    return round(float(np.corrcoef(delays_ms[1:], delays_ms[:-1])[0, 1]), 2) + 0.0  # no minus before a zero


def _overtaken(delays_ms: NDArray[np.float64]) -> float:
    """Return the per cent of messages, 1 ms apart, that come after a later one."""
    arrival_ms = np.arange(len(delays_ms)) + delays_ms
    return float(100 * np.mean(arrival_ms[:-1] > np.minimum.accumulate(arrival_ms[::-1])[::-1][1:]))


def _loss_row(name: str, p_loss: float, mean_burst: float, lost: NDArray[np.bool_]) -> list[str]:
    fit = fit_gilbert(lost)
    low, high = fit.p_loss_interval
    burst = "-" if fit.mean_burst is None else f"{fit.mean_burst:.3f}"
    return [
        name,
        f"{100 * p_loss:.4g} %",
        f"{100 * lost.mean():.4g} % ({100 * low:.4g} to {100 * high:.4g})",
        f"{mean_burst:.3f}",
        burst,
    ]


def loss_table() -> str:
    """Return the table of losses in bursts."""
    rows = []
    for name, part in _LOSSES.items():
        pipeline = Pipeline.model_validate({"loss": part})
        expected = expected_loss(pipeline.loss, {})
        rows.append(_loss_row(name, expected.p_loss, expected.mean_burst, _simulated({"loss": part}).lost))
    return _markdown(["model", "asked", "lost", "burst asked", "burst drawn"], rows)


def tc_table() -> str:
    """Return the table of losses by tc-netem's algorithm, beside ours."""
    u = Stream.named(_SEED, "tc_loss").uniforms(0, _N + 1)
    rows = []
    for p_loss, rho in _TC_LOSSES:
        theirs = loss_with_correlation(_N, p_loss, rho, u)
        burst = 1 / (1 - p_loss) / (1 - rho)
        ours = _simulated({"loss": {"kind": "burst", "p_loss": p_loss, "mean_burst": burst}}).lost
        rows.append(
            [f"loss {100 * p_loss:g}% {100 * rho:g}%", f"{100 * theirs.mean():.4g} %", f"{100 * ours.mean():.4g} %"]
        )
    return _markdown(["asked", "tc-netem's algorithm", "here"], rows)
