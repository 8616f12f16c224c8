"""Touch as a whole, in virtual time: bit-equal, replayed from its logs, passive, and safe where the network fails."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.deploy.run.energy_from_logs import Array, energy_mj, rows, vectors
from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.common.scenario.reading import dump_scenario
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.replay import replay
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder
from tis.patient_side.identification.model_file import dump_models

SHORT = ("rate_hz=250", "identification.train_samples=1000", "duration_s=3", "drain_s=0.2", "estimators=[hold]")
LOSSY = tuple(f"network.{way}.loss={{kind: bernoulli, p_loss: 0.1}}" for way in ("forward", "feedback"))
DEADBANDS = ("touch.deadband={force: 0.1, motion: 0.1}", "touch.fade_after_ms=200")


def _scenario(*settings: str) -> Scenario:
    return resolve("touch", (*SHORT, *settings), None, None)


def _twin(run_dir: Path, *settings: str) -> dict[str, Any]:
    """Run a twin; return its summary."""
    scenario = _scenario(*settings)
    folder.create(run_dir, scenario)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, run_dir)
    (run_dir / "model.json").write_bytes(dump_models(models))
    return build_summary(load_run(run_dir), scenario, models, "twin", 0, "")


def _shown(run_dir: Path) -> tuple[Array, Array, Array]:
    """Return instants in s (N,), places in m and forces of the hand on the coupling in N (N, 3)."""
    shown = list(rows(run_dir, "surgeon", "tis/MTML/servo_cf"))
    instants = np.array([row["sample_ns"] for row in shown]) / 1e9
    return instants, vectors(shown, "position_m"), -vectors(shown, "force_n")


@pytest.mark.parametrize(
    "settings",
    [("touch.coupling=tdpa", *LOSSY, *DEADBANDS), ("touch.coupling=wave", *LOSSY), DEADBANDS],
    ids=["tdpa", "wave", "position_force"],
)
def test_a_twin_repeats_bit_for_bit_and_both_sides_are_replayed_from_their_logs(
    tmp_path: Path, settings: tuple[str, ...]
) -> None:
    for name in ("one", "two"):
        _twin(tmp_path / name, *settings)
    for log in ("surgeon.mcap", "netem.mcap", "patient.mcap"):
        assert (tmp_path / "one" / log).read_bytes() == (tmp_path / "two" / log).read_bytes()
    found = replay(tmp_path / "one")
    assert found.identical, str(found)
    assert found.n_compared > 750 * 3


def test_what_a_deadband_keeps_back_is_no_loss(tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    summary = _twin(run_dir, *DEADBANDS)
    assert summary["problems"] == []
    forward = summary["links"]["forward"]
    assert forward["sent"] == forward["offered"] < 1.9 * 750
    shown = list(rows(run_dir, "surgeon", "tis/MTML/servo_cf"))
    sent = [row["tick"] for row in shown if row["sent"]]
    samples = [row["sample_ns"] for row in rows(run_dir, "surgeon", "tis/PSM2/setpoint_cp")]
    assert samples == [k * 4_000_000 for k in sent]
    contacts = list(rows(run_dir, "patient", "/tis/contacts"))
    ticks = [row["tick"] for row in rows(run_dir, "patient", "tis/PSM2/measured_cf")]
    assert ticks == [row["tick"] for row in contacts if row["sent"]]
    assert 0 < len(ticks) < 0.9 * len(contacts)


@pytest.mark.parametrize("coupling", ["wave", "tdpa"])
def test_a_passive_coupling_gives_the_hand_no_energy(tmp_path: Path, coupling: str) -> None:
    settings = ("touch.environment.stiffness_n_m=1500", "network.forward.delay.delay_ms=50", *LOSSY)
    _twin(tmp_path / "run", f"touch.coupling={coupling}", *settings)
    assert energy_mj(tmp_path / "run").min() >= -0.1


def test_the_force_fades_when_all_feedback_is_lost_in_contact(tmp_path: Path) -> None:
    outage = "network.timeline=[{at_s: 1.0, direction: feedback, set: {outage: true}}]"
    _twin(tmp_path / "run", "touch.environment.distance_mm=-3", outage)
    instants, _, forces = _shown(tmp_path / "run")
    size = np.linalg.norm(forces, axis=1)
    assert size[(instants > 0.9) & (instants < 1.0)].min() > 0.0
    assert size[instants >= 1.0 + 0.1 + 0.02].max() == 0.0


def test_an_arm_that_is_pressed_too_hard_stops_and_retreats_again(tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    _twin(run_dir, "touch.contact_stop_n=0.3", "touch.environment.distance_mm=1")
    causes = [row["cause"] for row in rows(run_dir, "patient", "/tis/safety")]
    assert "contact" in causes
    assert "sound" in causes[causes.index("contact") :]


def test_without_a_wall_in_reach_the_hand_does_what_it_intends(tmp_path: Path) -> None:
    _twin(tmp_path / "run", "touch.environment.distance_mm=900")
    shown = list(rows(tmp_path / "run", "surgeon", "tis/MTML/servo_cf"))
    assert (vectors(shown, "position_m") == vectors(shown, "intended_m")).all()
    assert not vectors(shown, "force_n").any()


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("touch.environment.stiffness_n_mm=0.4", "stiffness_n_mm"),
        ("touch.environment.stiffness_n_m=0.4", "stiffness_n_m"),
        ("touch.environment={kind: wall, position_mm: [0, 0, 5000]}", "position_mm"),
        ("touch.operator.mass_kg=-0.8", "mass_kg"),
        ("patient.plant.mass_kg=-1", "mass_kg"),
        ("touch.deadband.force=1.5", "deadband.force"),
        ("patient.plant={kind: replay}", "servo or mujoco with touch"),
        ("touch={coupling: wave, deadband: {motion: 0.1}}", "must be 0 with coupling wave"),
        ("touch.environment.normal=[0, 0, 0]", "direction"),
        ("touch.environment={kind: wall, distance_mm: 1, position_mm: [0, 0, 0]}", "exclude each other"),
        ("touch={deadband: {force: 0.1, keep_alive_ms: 90}}", "keep_alive_ms"),
    ],
)
def test_what_cannot_be_is_refused_in_words(setting: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        _scenario(setting)


def test_a_coupling_without_the_arms_spring_is_refused() -> None:
    with pytest.raises(InputError, match=r"must be servo with touch\.coupling tdpa"):
        _scenario("patient.plant={kind: mujoco}", "touch.coupling=tdpa")


def test_a_scenario_without_touch_does_not_mention_it() -> None:
    assert "touch" not in dump_scenario(resolve("default", (), None, None))
