"""A module that a side loads at a packet or tick delays it: all are loaded when the nodes are built."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.deploy.commands import call
from tis.common.estimators import ESTIMATORS, scenario_name

_ROOT = Path(__file__).resolve().parents[3]
_TWIN = """\
import sys
from tis.common.runtime.recordings import load_recording
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import drive
from tis.netem.build import build_netem
from tis.patient_side.build import build_patient
from tis.patient_side.identification.model_file import parse_models
from tis.surgeon_side.build import build_surgeon

class Log:
    def record(self, *_): pass

scenario = resolve("default", sys.argv[2:], None, 2.0)
recording = load_recording(scenario)
models = parse_models(open(sys.argv[1], "rb").read(), sys.argv[1])
nodes = {"surgeon": build_surgeon(scenario, recording), "netem": build_netem(scenario),
         "patient": build_patient(scenario, models, recording)}
built = set(sys.modules)
drive(scenario, nodes, {side: Log() for side in nodes})
print(" ".join(sorted(set(sys.modules) - built)))
"""
_EMULATOR = """\
import os, sys
from tis.common.messages import Header
from tis.common.node import Arrival
from tis.deploy.run.resolve import resolve
from tis.netem.build import build_netem

def added(network):
    node = build_netem(resolve("default", [network], None, 20.0))
    built = set(sys.modules)
    for seq in range(500):
        now_ns = seq * 10**9 // 30
        node.wake(now_ns)
        node.receive(Arrival("west", "tis/MTML/measured_cp", b"{}", Header(seq, now_ns).pack(), now_ns))
    return sorted(set(sys.modules) - built)

for network in sys.argv[1:]:  # each in a process that has loaded what is above, and nothing for another network
    sys.stdout.flush()
    if (child := os.fork()) == 0:
        print("network", *added(network))
        break
    assert os.waitpid(child, 0)[1] == 0
"""
_NETWORKS = (
    "forward.delay={kind: gamma, mean_ms: 20, std_ms: 5}",
    "forward.delay={kind: lognormal, mean_ms: 9, std_ms: 3}",
    "forward.delay={kind: pareto, scale_ms: 5, shape: 3}",
    "forward.delay={kind: hyperexponential, weights: [1], means_ms: [5]}",
    "forward.jitter={kind: normal, std_ms: 1}",
    "forward.correlation={half_life_s: 1}",
    "forward.loss={kind: pareto_runs, received: {shape: 2, scale: 9}, lost: {shape: 2, scale: 2}}",
    "outages=[{kind: poisson, mean_gap_s: 0.5, mean_s: 0.1}]",
)
_ESTIMATORS = ", ".join(f'"{scenario_name(name)}"' for name, row in ESTIMATORS.items() if not row.learned)


def _said_by(code: str, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code, *words], cwd=_ROOT, capture_output=True, text=True, check=False
    )
    assert not done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.json"
    code, _, err = call("identify", "default", "--set", f"estimators=[{_ESTIMATORS}]", "-o", str(path))
    assert code == 0, err
    return path


@pytest.mark.parametrize(
    "settings", [[], [f"estimators=[{_ESTIMATORS}]", "patient.plant={kind: servo, sensor_noise_mm: 0.1}"]]
)
def test_a_run_loads_nothing_more(model: Path, settings: list[str]) -> None:
    assert _said_by(_TWIN, str(model), *settings) == ""


def test_the_emulator_loads_nothing_more() -> None:
    assert _said_by(_EMULATOR, *(f"network.{network}" for network in _NETWORKS)).split("\n") == (
        ["network"] * len(_NETWORKS)
    )


@pytest.mark.parametrize("module", ["surgeon_side.__main__", "netem.__main__", "deploy.cli.main", "deploy.run.live"])
def test_scipy_is_loaded_only_by_who_computes_with_it(module: str) -> None:
    found = _said_by(f"import sys, tis.{module}; print(*(name for name in sys.modules if name.startswith('scipy.')))")
    assert not {"scipy.special", "scipy.signal", "scipy.stats", "scipy.linalg", "scipy.spatial"} & set(found.split())


def test_the_help_of_a_command_loads_nothing_of_a_run() -> None:
    """It would take twice as long."""
    found = _said_by("import sys, tis.deploy.cli.main; print(*sys.modules)")
    assert not {"numpy", "pydantic", "msgspec", "zenoh", "mcap", "yaml"} & set(found.split())


def test_the_patient_loads_no_signal_processing() -> None:
    """It would nearly double the time that it takes to load."""
    found = _said_by(
        "import sys, tis.patient_side.__main__; print(*(each for each in sys.modules if each[:5] == 'scipy'))"
    )
    assert not {"scipy.signal", "scipy.stats", "scipy.interpolate", "scipy.optimize"} & set(found.split())
