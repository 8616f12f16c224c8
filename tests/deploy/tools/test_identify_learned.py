"""`tis identify` with learned methods, and runs with the models that it writes."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.deploy.commands import call
from tests.patient_side.arm_models import static_model
from tests.patient_side.learned.models import learned_model
from tis.common.estimators import scenario_name
from tis.deploy.run.resolve import resolve
from tis.deploy.tools.identify import learned_names, learned_text
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.models import read_models

TRAIN = (
    "identification.method=cnn",
    "identification.learning={epochs: 2, passes: 1}",
    "identification.train_samples=600",
)


def with_settings(*settings: str) -> list[str]:
    return [word for setting in settings for word in ("--set", setting)]


def test_methods_and_estimators_are_trained_once_each() -> None:
    settings = [
        "identification.method=cnn",
        "estimators=[hold, 'tis.patient_side.estimators:gpr', 'tis.patient_side.estimators:cnn']",
        "active_estimator=hold",
    ]
    assert learned_names(resolve("default", settings)) == ["cnn", "gpr"]
    assert learned_names(resolve("default")) == []


def test_a_model_is_described_by_its_training() -> None:
    text = learned_text(learned_model("cnn"))
    assert text.endswith("weights, 3 epochs of 100 examples, seed 0; error 0.700 of the linear forecast's on D")


@pytest.mark.parametrize(
    ("out", "fault"),
    [
        ([], "--out: is needed, as training cnn takes minutes"),
        (["--out", "m.json"], "--out: must end in .safetensors, as learned models have weights"),
    ],
)
def test_without_a_file_for_its_weights_nothing_is_trained(out: list[str], fault: str) -> None:
    code, _, err = call("identify", "default", *out, *with_settings(*TRAIN))
    assert code == 2
    assert fault in err
    assert len(err.strip().splitlines()) == 1


def test_a_trained_model_runs_as_a_twin_and_replays_bit_for_bit(tmp_path: Path) -> None:
    pytest.importorskip("optax", reason="needs the extra learned")
    file = tmp_path / "m.safetensors"
    code, out, err = call("identify", "default", "--out", str(file), *with_settings(*TRAIN))
    assert code == 0, err
    assert re.search(
        r"cnn, without those held out: epoch 2 of 2, \d\.\d{3} of the linear forecast's error on those learned, on "
        r"those held out \d\.\d{3}\n",
        err,
    )
    assert "of the linear forecast's on last rows" in " ".join(out.replace("│", " ").split())
    check_run(file, "cnn", tmp_path / "run")


def test_a_model_file_with_weights_runs_as_a_twin_and_replays_bit_for_bit(tmp_path: Path) -> None:
    file = tmp_path / "m.safetensors"
    file.write_bytes(dump_models([static_model()]))
    check_run(file, "transformer", tmp_path / "run")


def check_run(file: Path, name: str, run_dir: Path) -> None:
    """Run a twin with the file's model, and replay it with the models in its folder."""
    name = scenario_name(name)
    settings = (f"identification.train={file}", f"estimators=[hold, '{name}']", f"active_estimator={name}")
    words = ["--run-dir", str(run_dir), "--duration-s", "4", *with_settings(*settings)]
    code, _, err = call("twin", "default", *words)
    assert code == 0, err
    code, out, err = call("replay", str(run_dir))
    assert code == 0, err
    assert "identical, bit for bit" in out
    stored = read_models(run_dir / "model.safetensors")[0]
    for one, other in zip(read_models(file)[0].learned, stored.learned, strict=True):
        assert all(np.array_equal(one.weights[key], other.weights[key]) for key in one.weights)


def test_a_run_with_a_method_that_its_file_does_not_hold_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.json"
    file.write_bytes(dump_models([replace(static_model(), learned=())]))
    settings = (
        f"identification.train={file}",
        "estimators=[hold, 'tis.patient_side.estimators:gpr']",
        "active_estimator=tis.patient_side.estimators:gpr",
    )
    code, _, err = call(
        "twin", "default", "--run-dir", str(tmp_path / "run"), "--duration-s", "4", *with_settings(*settings)
    )
    assert code == 4
    assert "model: learned: the model holds none for gpr: train one with `tis identify" in err
    assert not (tmp_path / "run").exists()
