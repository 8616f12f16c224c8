"""Record, fit, replay, measure: what comes out is what went in, within bounds that 10^5 messages allow."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tis.common.scenario.network import NetworkPart
from tis.common.trace import LOST, Trace, render_trace
from tis.deploy.net.fit import Records, fit_records, profile_of, records
from tis.deploy.net.profiles import dump_profile, library
from tis.netem.expected.simulate import simulate
from tis.netem.fit.half_life import fit_half_life
from tis.netem.fit.record import DirectionRecord

N = 100_000
LINKS: dict[str, dict[str, Any]] = {
    "gamma": {
        "loss": {"kind": "burst", "p_loss": 0.02, "mean_burst": 4},
        "delay": {"kind": "gamma", "shift_ms": 20, "mean_ms": 8, "std_ms": 4},
        "correlation": {"half_life_s": 0.02},
    },
    "lognormal": {
        "loss": {"kind": "burst", "p_loss": 0.05, "mean_burst": 2},
        "delay": {"kind": "lognormal", "shift_ms": 5, "mean_ms": 6, "std_ms": 3},
    },
    "normal": {
        "loss": {"kind": "bernoulli", "p_loss": 0.03},
        "delay": {"kind": "normal", "mean_ms": 50, "std_ms": 5},
        "correlation": {"half_life_s": 0.05},
    },
    "quantiles": {
        "delay": {
            "kind": "quantiles",
            "points": [
                {"p": 0, "delay_ms": 5},
                {"p": 0.5, "delay_ms": 10},
                {"p": 0.6, "delay_ms": 40},
                {"p": 1, "delay_ms": 60},
            ],
        },
        "correlation": {"half_life_s": 0.01},
    },
}


def record(network: NetworkPart, seed: int, rate_hz: int) -> Trace:
    sent_ns = np.arange(N, dtype=np.int64) * 10**9 // rate_hz
    fates = simulate(network, "forward", seed, sent_ns)
    return Trace(f"seed {seed}", sent_ns, np.where(fates.lost, LOST, fates.delay_ns), {"made": "by the models"})


def measured(trace: Trace) -> dict[str, float]:
    lost = trace.delay_ns == LOST
    delay_ms = trace.delay_ns[~lost] / 1e6
    begins = lost & ~np.concatenate(([False], lost[:-1]))
    return {
        "mean": float(delay_ms.mean()),
        "std": float(delay_ms.std()),
        "p99": float(np.percentile(delay_ms, 99)),
        "loss": float(lost.mean()),
        "burst": float(lost.sum() / max(1, begins.sum())),
        "half_life": fit_half_life(trace.sent_ns[~lost], trace.delay_ns[~lost]).seconds or 0.0,
    }


BOUNDS = {"mean": 0.01, "std": 0.04, "p99": 0.02, "loss": 0.10, "burst": 0.06, "half_life": 0.15}


@pytest.mark.parametrize(
    ("kind", "rate_hz"), [("gamma", 1000), ("lognormal", 1000), ("normal", 200), ("quantiles", 200)]
)
def test_record_fit_replay_measure_closes(
    kind: str, rate_hz: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    asked = NetworkPart.model_validate({"forward": LINKS[kind]})
    first = record(asked, 1, rate_hz)
    Path("trace.csv").write_text(render_trace(first))
    found = records(Path("trace.csv"), "forward")
    fits, unfitted = fit_records(found, n_replays=0)
    assert not unfitted
    profile = profile_of("closed", found, fits)
    Path("closed.yaml").write_text(dump_profile(profile))
    replayed = NetworkPart.model_validate(library("closed.yaml"))
    assert replayed.forward.delay is not None
    assert replayed.forward.delay.kind == kind
    assert (replayed.forward.correlation is None) == ("correlation" not in LINKS[kind])
    was, now = measured(first), measured(record(replayed, 2, rate_hz))
    for figure, bound in BOUNDS.items():
        assert now[figure] == pytest.approx(was[figure], rel=bound), figure


def test_the_profile_says_where_its_numbers_come_from() -> None:
    trace = record(NetworkPart.model_validate({"forward": LINKS["gamma"]}), 1, 1000)
    both: Records = dict.fromkeys(("forward", "feedback"), DirectionRecord.of(trace))
    profile = profile_of("p", both, fit_records(both, n_replays=0)[0])
    assert "made: by the models" in profile.sources["record"]
    assert {number.basis for number in profile.numbers} == {"fitted"}
    assert "stands for both" in profile.notes
    assert profile.network.forward == profile.network.feedback
