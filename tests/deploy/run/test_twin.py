"""The twin as a whole: bit-equal, consistent with the models it runs, and as good as it should be."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.deploy.hold_only import HOLD
from tests.deploy.run import golden_figures
from tis.common.errors import InputError
from tis.common.records import ESTIMATES, TICKS
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.logs.read.packets import DELIVER, link_fates
from tis.deploy.logs.read.side_log import OUTCOMES
from tis.deploy.report.subjects.network.requested import Requested
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.consistency import compare_fates
from tis.deploy.run.replay import replay
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell.shipped_scenarios import shipped_names
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.statespace import ArmModel

LOGS = ("surgeon.mcap", "netem.mcap", "patient.mcap")


def _twin(scenario: Scenario, run_dir: Path) -> tuple[RunLogs, tuple[ArmModel, ...]]:
    from tis.deploy.shell import run_dir as folder

    folder.create(run_dir, scenario)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, run_dir)
    return load_run(run_dir), models


def _short(*settings: str) -> Scenario:
    return resolve("default", settings, None, 6.0)


def _summary(scenario: Scenario, run_dir: Path) -> dict[str, Any]:
    logs, models = _twin(scenario, run_dir)
    return build_summary(logs, scenario, models, "twin", 0, "")


@pytest.fixture(scope="module")
def plain_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a twin of 6 s, as it is without any setting."""
    run_dir = tmp_path_factory.mktemp("plain") / "run"
    _twin(_short(), run_dir)
    return run_dir


@pytest.fixture(scope="module")
def plain(plain_dir: Path) -> RunLogs:
    """The logs of that twin."""
    return load_run(plain_dir)


@pytest.fixture(scope="module")
def outage(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunLogs, dict[str, Any]]:
    """The logs of a twin of 9 s with an outage from 6 to 6.5 s, and its summary."""
    scenario = resolve("outage", HOLD, None, 9.0)
    logs, models = _twin(scenario, tmp_path_factory.mktemp("outage") / "run")
    return logs, build_summary(logs, scenario, models, "twin", 0, "")


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], dict[str, Any]]:
    """Return a function that gives the summary of a shipped scenario's twin of some seconds, made once."""

    @cache
    def summary_of(name: str) -> dict[str, Any]:
        return _summary(golden_figures.short(name), tmp_path_factory.mktemp(name) / name)

    return summary_of


def test_two_twins_write_the_same_bytes(tmp_path: Path, plain_dir: Path, models_anew: None) -> None:
    """The models of the second one are identified anew."""
    _twin(_short(), tmp_path / "two")
    for log in LOGS:
        assert (plain_dir / log).read_bytes() == (tmp_path / "two" / log).read_bytes()


def test_another_seed_gives_other_fates(tmp_path: Path, plain: RunLogs) -> None:
    two, _ = _twin(resolve("default", HOLD, 8, 6.0), tmp_path / "two")
    assert compare_fates(plain, two, _short()).n_different > 300


def test_more_loss_leaves_every_delay_as_it_was(tmp_path: Path, plain: RunLogs) -> None:
    """Scenarios that differ in one stage see the same draws of the others: comparisons are paired."""
    two, _ = _twin(_short("network.forward.loss.p_loss=0.3", *HOLD), tmp_path / "two")
    delays = []
    for logs in (plain, two):
        fates = link_fates(logs, "forward")
        through = fates.at(fates.outcome == DELIVER)
        delays.append(
            dict(
                zip(
                    zip(through.key.tolist(), through.seq.tolist(), strict=True),
                    through.delay_ns.tolist(),
                    strict=True,
                )
            )
        )
    assert len(delays[1]) < 0.8 * len(delays[0])
    assert delays[1].items() <= delays[0].items()


def test_the_books_balance_and_the_parts_of_latency_add_up(tmp_path: Path) -> None:
    scenario = _short("network.forward.ordering=drop_late", "network.forward.jitter.std_ms=20", *HOLD)
    summary = _summary(scenario, tmp_path / "run")
    assert summary["problems"] == []
    link = summary["links"]["forward"]
    assert link["sent"] == link["offered"] == 2 * 180
    assert link["offered"] == link["released"] + link["dropped"] + link["held_at_end"]
    assert link["released"] == link["received"]
    assert link["verdict"]["violations"] == []
    assert set(link["keys"]) == {"tis/MTML/measured_cp", "tis/PSM2/setpoint_cp"}
    for key in link["keys"].values():
        assert key["verdict"]["faithful"]
        assert key["delay_ms"]["decided"]["mean"] == pytest.approx(key["delay_ms"]["requested"]["mean"], abs=5)
    assert link["dropped_by"]["late"] > 0
    assert link["reordered"] == 0
    assert link["release_error_us"]["max"] == 0
    assert link["delay_ms"]["decided"]["mean"] == pytest.approx(40, abs=3)


def test_a_constant_delay_gives_the_latency_that_arithmetic_gives(tmp_path: Path) -> None:
    """50 ms one way, ticks 2 ms after each sample: sample k is used at tick k + 2, 66.67 + 2 ms later."""
    scenario = _short("network={forward: {delay: {kind: constant, delay_ms: 50}}}", *HOLD)
    latency = _summary(scenario, tmp_path / "run")["latency_ms"]
    assert latency["network"]["max"] == 50
    assert latency["end_to_end"]["p50"] == pytest.approx(2 * 1000 / 30 + 2, abs=1e-5)
    assert latency["tick_wait"]["p50"] == pytest.approx(2 * 1000 / 30 + 2 - 50, abs=1e-5)
    assert latency["surgeon"]["max"] == latency["compute"]["max"] == 0
    assert latency["round_trip"]["p50"] == latency["end_to_end"]["p50"]


def test_an_outage_drops_exactly_what_is_offered_meanwhile(outage: tuple[RunLogs, dict[str, Any]]) -> None:
    fates = link_fates(outage[0], "forward")
    lost = fates.seq[fates.outcome == OUTCOMES.index("outage")]
    expected = [k for k in range(270) if 6_000_000_000 <= k * 10**9 // 30 < 6_500_000_000]
    assert sorted(set(lost.tolist())) == expected
    assert len(lost) == 2 * len(expected)


def test_the_age_shows_an_outage_that_the_latency_of_arrivals_cannot(outage: tuple[RunLogs, dict[str, Any]]) -> None:
    """0.5 s of silence from 6 s on: the last sample before is of 5.967 s, the next comes at some 6.53 s."""
    _, summary = outage
    assert summary["latency_ms"]["end_to_end"]["max"] < 80
    assert 500 < summary["age_ms"]["max"] < 600
    assert summary["age_ms"]["p50"] == pytest.approx(1000 / 30 + 2, abs=1e-3)


def test_a_twin_replays_bit_for_bit(tmp_path: Path) -> None:
    logs, models = _twin(resolve("default", ["source.hands=[left, right]"], None, 4.0), tmp_path / "run")
    (tmp_path / "run" / "model.json").write_bytes(dump_models(models))
    found = replay(tmp_path / "run")
    assert found.identical
    driven = sum(len(logs.of("patient", f"tis/{arm}/servo_cp")) for arm in ("PSM1", "PSM2"))
    assert found.n_compared == 2 * (4 + 2) * 120 + driven  # four estimators, two orientation methods
    assert driven > 2 * 110


def test_a_servo_executes_the_active_estimate_and_is_scored(shipped: Callable[[str], dict[str, Any]]) -> None:
    summary = shipped("lossy")
    assert summary["accuracy"]["plant"]["rmse_3d_mm"] > 0
    assert set(summary["accuracy_by_hand"]) == {"left", "right"}
    assert summary["links"]["forward"]["reordered"] > 0


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in golden_figures.FAST else [])
        for name in golden_figures.names()
    ],
)
def test_shipped_scenarios_without_data_are_valid_with_their_figures(
    name: str, shipped: Callable[[str], dict[str, Any]]
) -> None:
    if name == "simulated_arm":
        pytest.importorskip("mujoco", reason="the extra sim is not installed")
    if name == "sight":
        pytest.importorskip("PIL", reason="the extra report is not installed")
    summary = shipped(name)
    assert summary["valid"], summary["problems"]
    assert set(summary["quarantined"].values()) == {0}
    if name != "touch_unstable":
        assert summary["accuracy"]["innovations_kf"]["ratio_to_hold"] < 1
    found = json.loads(json.dumps(golden_figures.figures(summary)))
    assert [*golden_figures.differences(golden_figures.kept(name), found)] == []


def test_a_figure_that_changes_is_named() -> None:
    kept = {"a": [1.0, {"b": True}], "c": None}
    assert [*golden_figures.differences(kept, {"a": [1.0 + 1e-12, {"b": True}], "c": None})] == []
    found = {"a": [1.0 + 1e-8, {"b": False}], "d": 0}
    told = ["a[0]: 1.0 -> 1.00000001", "a[1].b: True -> False", "c: None -> absent", "d: absent -> 0"]
    assert [*golden_figures.differences(kept, found)] == told


def test_what_happens_elsewhere_in_real_time_has_no_twin() -> None:
    rate = "network.forward.rate={kbit_s: 8, backpressure: true}"
    with pytest.raises(InputError) as refused:
        build_sides(resolve("live", ["patient.plant.kind=external", rate]))
    found = [str(fault) for fault in refused.value.faults]
    assert found == [
        "scenario live: source.kind: must be recorded or synthetic in virtual time: nothing tells what a live device "
        "would do (got 'live')",
        "scenario live: patient.plant.kind: must be replay, servo or mujoco in virtual time: an external arm moves "
        "in real time only (got 'external')",
        "scenario live: network.*.rate.backpressure: must be false in virtual time: no sender of Zenoh is there that "
        "could wait or drop (got True)",
    ]


def test_all_shipped_scenarios_are_valid() -> None:
    of_the_paper = (f"paper_{row}" for row in range(1, 7))
    assert shipped_names() == sorted(
        [
            "default",
            "drive",
            "drive_touch",
            "kilohertz",
            "lagging_arm",
            "live",
            "lossy",
            "outage",
            "sight",
            "simulated_arm",
            "touch",
            "touch_and_sight",
            "touch_unstable",
            *of_the_paper,
        ]
    )
    for name in shipped_names():
        assert resolve(name).name == name


def test_on_a_real_trial_the_filter_beats_hold_at_200_ms(
    tmp_path: Path, jigsaws_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TIS_JIGSAWS", str(jigsaws_dir))
    network = "network={forward: {delay: {kind: constant, delay_ms: 200}}}"
    estimators = ("estimators=[hold, innovations_kf]", "active_estimator=innovations_kf", HOLD[-1])
    summary = _summary(resolve("paper_3", [network, *estimators]), tmp_path / "run")
    assert summary["ticks"]["count"] == 900
    assert summary["identification"]["static"]
    assert summary["accuracy"]["innovations_kf"]["n_scored"] > 800
    assert summary["accuracy"]["innovations_kf"]["ratio_to_hold"] <= 0.65


def test_no_estimate_depends_on_what_arrives_after_its_tick(tmp_path: Path, plain: RunLogs) -> None:
    """Cutting the network off at 4 s changes nothing before; the tick after it may differ."""
    cut = "network.timeline=[{at_s: 4, for_s: 9, set: {outage: true}}]"
    rows = []
    for logs in (plain, _twin(_short(cut), tmp_path / "cut")[0]):
        rows.append(
            {(r["tick"], r["hand"]): r["position_m"] for r in logs.of("patient", f"{ESTIMATES}/innovations_kf")}
        )
        assert len(logs.of("patient", TICKS)) == 180
    before = [key for key in rows[0] if key[0] < 4 * 30]
    assert before
    assert all(rows[0][key] == rows[1][key] for key in before)
    assert any(rows[0][key] != rows[1][key] for key in rows[0])
    assert np.isfinite([v["x"] for v in rows[1].values() if v]).all()


def test_a_log_holds_the_traces_that_its_run_used(tmp_path: Path) -> None:
    trace = tmp_path / "measured.csv"
    trace.write_text("sent_s,delay_ms\n" + "".join(f"{i / 10},{20 + i}\n" for i in range(100)))
    scenario = _short(f"network.forward={{delay: {{kind: trace, path: {trace}}}}}", *HOLD)
    run, _ = _twin(scenario, tmp_path / "run")
    trace.unlink()
    kept = run.attachments("netem")
    nodes, models, _ = build_sides(scenario, (), kept)
    trace.write_text("sent_s,delay_ms\n0,1\n")  # what lies there now is another network
    run_twin(scenario, nodes, models, tmp_path)
    assert compare_fates(run, load_run(tmp_path), scenario).identical
    asked = Requested.of(scenario, "forward", run).of_packets("tis/MTML/measured_cp", link_fates(run, "forward"))
    assert asked is not None
    assert np.all(asked.delay_ns >= 20e6)
