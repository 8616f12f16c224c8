"""`tis identify --dynamics`: what it prints and writes, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tis.common.extras import Extra
from tis.deploy.cli.main import app
from tis.patient_side.dynamics import consistent_fit
from tis.patient_side.dynamics.parameters import pseudo_inertia
from tis.patient_side.plant import physics


def test_the_file_holds_the_table_and_bodies_that_can_exist(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="the extra sim is not installed")
    pytest.importorskip("cvxpy", reason="the extra dynamics is not installed")
    file = tmp_path / "dynamics.json"
    done = CliRunner().invoke(app, ["identify", "simulated_arm", "--dynamics", "--out", str(file)])
    assert done.exit_code == 0, done.output
    found = json.loads(file.read_text())
    base = found["base_parameters"]
    determined = [row for row in base if row["determined"]]
    assert len(base) == 61
    assert max(abs(row["identified"] / row["true"] - 1.0) for row in determined) < 0.05
    assert f"{len(determined)} of 61 base parameters are determined" in " ".join(done.stdout.split())
    assert max(found["torque_error_pct"].values()) < 5.0
    assert len(found["links"]) == len(found["joints"]) == 7
    for link in found["links"]:
        assert np.linalg.eigvalsh(pseudo_inertia(np.array(list(link.values()))))[0] > 0.0


def test_all_wrong_options_are_named_at_once(tmp_path: Path) -> None:
    words = ["identify", "default", "--dynamics", "--out", str(tmp_path / "x.txt"), "--figure", "f.svg"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    said = " ".join(done.stderr.split())
    assert "patient.plant: kind: must be mujoco with --dynamics" in said
    assert "tis identify: --out: must end in .json" in said
    assert "tis identify: --figure: must not be given with --dynamics" in said


@pytest.mark.parametrize("missing", ["mujoco", "cvxpy"])
def test_a_missing_extra_is_named_before_anything_is_computed(
    missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def find(name: str) -> object | None:
        return None if name == missing else object()

    monkeypatch.setattr(physics, "find_spec", find)
    monkeypatch.setattr(consistent_fit, "find_spec", find)
    file = tmp_path / "dynamics.json"
    done = CliRunner().invoke(app, ["identify", "simulated_arm", "--dynamics", "--out", str(file)])
    assert done.exit_code == 2
    name = {"mujoco": "sim", "cvxpy": "dynamics"}[missing]
    assert str(Extra(name)) in " ".join(done.stderr.split())
    assert not file.exists()
