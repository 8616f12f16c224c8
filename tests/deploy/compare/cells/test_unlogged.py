"""Unlogged twins against logged ones: the same packets at the same instants, estimates and scores to the last bit."""

from pathlib import Path

import numpy as np
import pytest

from tis.common.channels import ORIGIN, Side
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.deploy.compare.cells.cell import Cell, run_cell
from tis.deploy.compare.cells.scores import logged_scores, unlogged_scores
from tis.deploy.compare.cells.shared_parts import SharedParts
from tis.deploy.compare.cells.unlogged import is_plain, run_unlogged
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.subjects.tracking import track_of_hand
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, drive
from tis.netem.node import NetemNode
from tis.patient_side.build import identify_models
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.node import PatientNode

SETTINGS = ("source.hands=[left, right]", "estimators=[innovations_kf, damped_velocity]", "duration_s=2.5")
NETWORKS = {
    "clear": "{}",
    "uniform, lost in bursts": "{forward: {loss: {kind: gilbert_elliott, p_bad: 0.1, p_good: 0.3}, delay: "
    "{kind: uniform, low_ms: 20, high_ms: 300}, ordering: reorder}}",
    "duplicates, late ones dropped": "{forward: {duplicate: {p_duplicate: 0.3}, delay: {kind: uniform, low_ms: 0, "
    "high_ms: 80}, ordering: drop_late}}",
    "a queue": "{forward: {rate: {kbit_s: 150, queue: {kind: tail_drop, max_bytes: 4000}}, delay: {kind: constant, "
    "delay_ms: 10}}}",
    "outages": "{forward: {delay: {kind: constant, delay_ms: 30}}, outages: [{kind: alternating, down: {low_s: 0.3, "
    "high_s: 0.6}, up: {low_s: 0.5, high_s: 1}, direction: forward}]}",
    "a timeline": "{forward: {delay: {kind: constant, delay_ms: 120}}, timeline: [{at_s: 1, direction: forward, set: "
    "{loss: {kind: bernoulli, p_loss: 0.5}}}, {at_s: 2, direction: forward, set: {clean: true}}]}",
    "a profile": "{profile: starlink_2025}",
    "little room": "{forward: {delay: {kind: constant, delay_ms: 200}}, "
    "buffer: {max_packets: 9, policy: drop_oldest}}",
}
HELD = "patient.orientation={methods: [hold], active: hold}"
"""For tests that do not look at the orientation: its methods take as long as all else."""
SENDING = {
    "once": (),
    "copies": ("surgeon={copies: 3, copy_spacing_ms: 7, sensor_noise_mm: 2}",),
    "history": ("surgeon={history: 2}", "patient.tick=phase_locked"),
    "observer": ("topology=observer", "patient.tick_phase_ms=5"),
}


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = resolve(
        "default", (*SETTINGS, "identification.order=2", "identification.train_samples=600"), None, None
    )
    recording = load_recording(scenario)
    head = recording.head(scenario.identification.train_samples)
    file = tmp_path_factory.mktemp("models") / "model.json"
    file.write_bytes(dump_models(identify_models(scenario, recording, [head])))
    return file


def scenario_of(model_file: Path, network: str, sending: tuple[str, ...]) -> Scenario:
    settings = (*SETTINGS, f"identification.train={model_file}", "source.start=600", f"network={network}", *sending)
    return resolve("default", settings, None, None)


@pytest.mark.parametrize("sending", SENDING)
@pytest.mark.parametrize("network", NETWORKS)
def test_packets_and_estimates_are_those_of_the_logged_twin(model_file: Path, network: str, sending: str) -> None:
    scenario = scenario_of(model_file, NETWORKS[network], (HELD, *SENDING[sending]))
    assert is_plain(scenario)
    recording, parts = load_recording(scenario), SharedParts()
    # Both twins.
    logged, models, _ = build_sides(scenario, recording=recording)
    memories: dict[Side, MemoryLog] = {side: MemoryLog(side) for side in logged}
    drive(scenario, logged, memories)
    logs = RunLogs(Path(), {side: memory.log for side, memory in memories.items()})
    nodes, _, _ = build_sides(scenario, recording=recording)
    patient, netem, theirs = nodes["patient"], nodes["netem"], logged["netem"]
    assert isinstance(patient, PatientNode)
    assert isinstance(netem, NetemNode)
    assert isinstance(theirs, NetemNode)
    link = netem.links[ORIGIN["forward"]]
    found = run_unlogged(scenario, recording, parts.samples(scenario, recording), link, patient)
    # Fates, and the packets that arrived.
    assert link.counters() == theirs.links[ORIGIN["forward"]].counters()
    arrived = {
        (int(ns), key, int(seq))
        for key, columns in logs.messages("patient", "forward", scenario.session).items()
        for ns, seq in zip(columns.log_ns, columns.seq, strict=True)
    }
    assert {(ns, key, seq) for ns, key, seq in found.arrived} <= arrived  # the log has second copies, too
    first = {(key, seq): ns for ns, key, seq in sorted(arrived, reverse=True)}
    assert {(key, seq): ns for ns, key, seq in found.arrived} == first
    # Truth, estimates, and what is scored.
    for model in models:
        expected, track = track_of_hand(logs, scenario, model.hand), found.scored[model.hand].track
        assert np.array_equal(expected.t_ns, track.t_ns)
        assert np.array_equal(expected.truth_m, track.truth_m, equal_nan=True)
        assert np.array_equal(expected.scored, track.scored)
        assert list(expected.estimates) == list(track.estimates)
        for name, positions in expected.estimates.items():
            assert np.array_equal(positions, track.estimates[name], equal_nan=True)


@pytest.mark.parametrize("sending", SENDING)
def test_scores_are_those_of_the_logged_twin(model_file: Path, sending: str) -> None:
    scenario = scenario_of(model_file, NETWORKS["uniform, lost in bursts"], SENDING[sending])
    recording = load_recording(scenario)
    one, other = logged_scores(scenario, recording), unlogged_scores(scenario, recording)
    assert (one.traffic, one.unscored, one.warnings) == (other.traffic, other.unscored, other.warnings)
    for hand, sums in one.hands.items():
        for name, entry in sums["estimators"].items():
            entry.pop("step_ns")  # measured
            other.hands[hand]["estimators"][name].pop("step_ns")
        assert set(sums["orientation"]) == {"hold", "tangent_ls"}
        for name, entry in sums["orientation"].items():
            entry.pop("step_ns")
            other.hands[hand]["orientation"][name].pop("step_ns")
        assert sums == other.hands[hand]


def test_a_moving_arm_and_flipped_bits_need_the_whole_twin(model_file: Path) -> None:
    moving = scenario_of(model_file, "{}", ("patient.plant={kind: servo, bandwidth_hz: 2}",))
    flipped = scenario_of(
        model_file, "{timeline: [{at_s: 1, direction: forward, set: {corrupt: {p_corrupt: 1}}}]}", ()
    )
    assert not is_plain(moving)
    assert not is_plain(flipped)
    for scenario in (moving, flipped):
        result = run_cell(Cell("d", None, "T", scenario, None), None)
        assert result["hands"]["left"]["n_scored"] > 0
    assert "plant" in run_cell(Cell("d", None, "T", moving, None), None)["hands"]["left"]["estimators"]


def test_a_twin_whose_patient_leaves_samples_unused_is_no_measurement(model_file: Path) -> None:
    """Half of the movement is out of a reach of 5 mm: `tis twin` calls that not valid, and so does a cell."""
    scenario = scenario_of(model_file, "{}", ("patient.gate.reach_m=0.005",))
    recording = load_recording(scenario)
    for scores in (unlogged_scores(scenario, recording), logged_scores(scenario, recording)):
        assert scores.unscored is not None
        assert "out of the arm's reach" in scores.unscored
        assert "patient.gate.reach_m" in scores.unscored


def test_a_twin_without_a_scored_tick_says_why(model_file: Path) -> None:
    scenario = scenario_of(model_file, "{forward: {loss: {kind: bernoulli, p_loss: 1}}}", ())
    result = run_cell(Cell("d", None, "T", scenario, None), None)
    assert result["hands"]["left"]["n_scored"] == 0
    assert result["unscored"] == "no message is known to have reached the patient"


def test_a_twin_with_few_unused_samples_is_scored_and_warns(
    model_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tis.deploy.compare.cells.scores.MAX_UNUSED", 0.9)
    scenario = scenario_of(model_file, "{}", ("patient.gate.reach_m=0.07",))
    recording = load_recording(scenario)
    for scores in (unlogged_scores(scenario, recording), logged_scores(scenario, recording)):
        assert scores.unscored is None
        [text] = [text for text in scores.warnings if "did not use" in text]
        assert text.startswith(f"{recording.label}: the patient did not use ")
        assert "raise the limits of patient.gate" in text
