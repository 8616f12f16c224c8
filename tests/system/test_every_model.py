"""Every stage and every process in time at once, live: the books balance, and the twin decides the same (L1)."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.system.conftest import StartHere, is_right_but_for_the_machine
from tis.common.scenario.reading import build_scenario
from tis.deploy.logs.read.load import load_run
from tis.deploy.run.consistency import compare_fates
from tis.deploy.run.twin import build_sides, run_twin
from tis.patient_side.identification.model_file import dump_models

pytestmark = pytest.mark.live

_TRACE = "sent_s,delay_ms\n" + "".join(f"{k / 50:.3f},{'' if k % 9 == 0 else 5 + k % 7}\n" for k in range(100))


def _scenario(trace: Path) -> dict[str, Any]:
    return {
        "version": 1,
        "name": "every_model",
        "duration_s": 6,
        "rate_hz": 100,
        "source": {"kind": "synthetic", "hands": ["left", "right"]},
        "estimators": ["hold"],
        "active_estimator": "hold",
        "network": {
            "forward": {
                "loss": {"kind": "burst", "p_loss": 0.05, "mean_burst": 3, "mtu_bytes": 1200},
                "duplicate": {"p_duplicate": 0.05},
                "corrupt": {"p_corrupt": 0.02, "bits": 2},
                "delay": {"kind": "gamma", "mean_ms": 20, "std_ms": 5, "shift_ms": 2},
                "jitter": {"kind": "normal", "std_ms": 1},
                "correlation": {"half_life_s": 0.1},
                "reorder": {"p_reorder": 0.05, "early_ms": 10},
                "ordering": "reorder",
            },
            "feedback": {
                "loss": {"kind": "trace", "path": str(trace)},
                "rate": {"kbit_s": 2000, "queue": {"kind": "codel"}},
                "delay": {"kind": "trace", "path": str(trace)},
                "ordering": "drop_late",
            },
            "rules": [
                {
                    "key": "*/MTMR/measured_cp",
                    "direction": "forward",
                    "pipeline": {
                        "loss": {"kind": "four_state", "p13": 0.02, "p31": 0.4, "p32": 0.1, "p23": 0.6, "p14": 0.01},
                        "delay": {"kind": "hyperexponential", "weights": [0.8, 0.2], "means_ms": [5, 20]},
                    },
                },
                {
                    "key": "*/PSM1/setpoint_cp",
                    "direction": "forward",
                    "pipeline": {
                        "loss": {
                            "kind": "pareto_runs",
                            "received": {"shape": 4, "scale": 30},
                            "lost": {"shape": 4, "scale": 3},
                        },
                        "rate": "link",
                        "delay": {"kind": "pareto", "scale_ms": 5, "shape": 3, "max_ms": 200},
                    },
                },
            ],
            "outages": [
                {"kind": "poisson", "mean_gap_s": 1, "mean_s": 0.1, "direction": "forward"},
                {"kind": "periodic", "every_s": 2, "for_s": 0.1},
            ],
            "states": {
                "kind": "markov",
                "states": [
                    {"name": "good", "mean_s": 0.8, "next": [{"to": "bad"}]},
                    {
                        "name": "bad",
                        "mean_s": 0.4,
                        "next": [{"to": "good"}],
                        "forward": {"scale_delay": 2, "add_p_loss": 0.1, "rate": {"kbit_s": 500}},
                    },
                ],
            },
            "timeline": [
                {"at_s": 2, "for_s": 2, "ramp_s": 0.5, "set": {"add_delay_ms": 30}},
                {
                    "at_s": 3,
                    "for_s": 1,
                    "direction": "feedback",
                    "set": {"loss": {"kind": "bernoulli", "p_loss": 0.3}},
                },
            ],
        },
    }


@pytest.mark.slow
def test_every_model_at_once(run_here: StartHere, tmp_path: Path) -> None:
    trace = tmp_path / "trace.csv"
    trace.write_text(_TRACE)
    nodes, models, _ = build_sides(build_scenario(_scenario(trace), "every_model.yaml"))
    (tmp_path / "model.json").write_bytes(dump_models(models))  # the patient's process need not find it again
    content = _scenario(trace) | {"identification": {"train": str(tmp_path / "model.json")}}
    file = tmp_path / "every_model.yaml"
    file.write_text(yaml.safe_dump(content))
    tis = run_here("run", str(file))
    code, _, err = tis.wait()
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    for name, link in summary["links"].items():
        assert link["offered"] + link["copied"] == link["released"] + link["dropped"] + link["held_at_end"], name
        assert link["dropped_by"]["outage"] > 0
    forward = summary["links"]["forward"]
    assert forward["copied"] > 10
    assert forward["dropped_by"]["loss"] > 50
    error_us = forward["release_error_us"]
    assert 0 <= error_us["p50"] < 5_000  # loosely: what it really is stands in `tis bench netem`

    scenario = build_scenario(content, "every_model.yaml")
    twin_dir = tmp_path / "twin"
    twin_dir.mkdir()
    run_twin(scenario, nodes, models, twin_dir)
    found = compare_fates(load_run(tis.run_dir), load_run(twin_dir), scenario)
    assert found.n_different == found.n_set_aside == 0
    assert found.n_compared > 1_500
