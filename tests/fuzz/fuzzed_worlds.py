"""Movements, models and honest streams of the fuzzed sides; each is made once in a process."""

from functools import cache
from typing import Any, Final, NamedTuple

from tis.common.channels import Hand, hand_channels
from tis.common.estimators import ESTIMATORS, scenario_name
from tis.common.messages import Header
from tis.common.node import Emission
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.common.sources.trajectory import Recording
from tis.patient_side.models import models_for
from tis.patient_side.statespace import ArmModel
from tis.surgeon_side.build import build_surgeon

SESSION: Final = "tis"
QUICK: Final = ("hold", "damped_velocity", "moesp_kf", scenario_name("velocity"))
"""Estimators that are identified within a second."""
LINEAR: Final = tuple(scenario_name(name) for name, row in ESTIMATORS.items() if not row.learned)
AT_1_KHZ: Final = (*QUICK, *map(scenario_name, ("hold_last_arrived", "static_gain", "innovations_kf")))
METHODS: Final = ("hold", "tangent_ls")


class World(NamedTuple):
    """What the runs of one rate and number of hands share."""

    raw: dict[str, Any]
    estimators: tuple[str, ...]
    recording: Recording
    models: tuple[ArmModel, ...]

    def scenario(self, **more: Any) -> Scenario:
        """Return the scenario with other fields."""
        return Scenario.model_validate({**self.raw, **more})


class Packet(NamedTuple):
    """An honest packet of the surgeon."""

    due_ns: int
    key: str
    payload: bytes
    header: Header


@cache
def world(rate_hz: int, hands: tuple[Hand, ...], quick: bool) -> World:
    """Return the world of this rate and these hands; ``quick``: with few estimators."""
    is_fast = rate_hz > 100
    estimators = QUICK if quick else AT_1_KHZ if is_fast else LINEAR
    raw: dict[str, Any] = {
        "version": 1,
        "name": "fuzz",
        "duration_s": 0.6 if is_fast else 4,
        "rate_hz": rate_hz,
        "source": {"kind": "synthetic", "hands": hands, **({"recorder_hz": None} if is_fast else {})},
        "estimators": estimators,
        "active_estimator": "hold",
        "patient": {"tick_phase_ms": 0.5},
        **({"identification": {"method": "arx", "train_samples": 4000}} if is_fast else {}),
    }
    scenario = Scenario.model_validate(raw)
    recording = load_recording(scenario)
    return World(raw, estimators, recording, models_for(scenario, recording))


@cache
def honest_stream(rate_hz: int, hands: tuple[Hand, ...], quick: bool, copies: int, history: int) -> list[Packet]:
    """Return all packets of the surgeon of a world, in their order."""
    made = world(rate_hz, hands, quick)
    surgeon = {"copies": copies, "copy_spacing_ms": 3 if copies > 1 else 0, "history": history}
    node = build_surgeon(made.scenario(surgeon=surgeon), made.recording)
    found = []
    while (due_ns := node.next_wake_ns()) is not None:
        for output in node.wake(due_ns):
            if isinstance(output, Emission) and isinstance(output.attachment, Header):
                header = output.attachment._replace(sent_ns=due_ns)
                found.append(Packet(due_ns, output.key, output.payload, header))
    return found


def answer_keys(hands: tuple[Hand, ...]) -> list[str]:
    """Return the keys of the patient's answers to these hands."""
    rows = [hand_channels(part.hand, part.arm) for part in world(30, hands, True).recording.hands]
    return [channel.key(SESSION) for row in rows for channel in (row.estimated, row.measured)]
