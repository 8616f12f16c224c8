"""Twin of a live run: the same three nodes in virtual time, in this process, bit-equal from run to run."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from tis.common.channels import Side
from tis.common.errors import InputError
from tis.common.node import Node
from tis.common.records import ControlNote
from tis.common.runtime.clock import VirtualClock
from tis.common.runtime.loop import Recorder, Seat, VirtualBus, run
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.memory import without_collector
from tis.common.runtime.recorder import FLUSH_EVERY_NS
from tis.common.runtime.recordings import load_recording
from tis.common.runtime.scenario_files import load_traces, trace_attachments
from tis.common.runtime.side_log import LOG_VERSION
from tis.common.runtime.user_code import USER_CODE_FILE, dump_origins
from tis.common.scenario import Scenario, virtual_time_faults
from tis.common.scenario import reading as scenario_io
from tis.common.sight.codec import check_codec
from tis.common.sources.provenance import RECORDING_FILE, dump_played
from tis.common.sources.trajectory import Recording
from tis.common.units import NS_PER_S
from tis.deploy.shell import run_dir as folder
from tis.netem.build import build_netem
from tis.netem.control.replay import with_live_changes
from tis.patient_side.build import build_patient
from tis.patient_side.camera import build_camera
from tis.patient_side.models import factories, model_attachment, models_for, origins, own_estimators
from tis.patient_side.node import PatientNode
from tis.patient_side.plant.physics import check_plant
from tis.patient_side.provenance import warnings_at_start
from tis.patient_side.statespace import ArmModel
from tis.surgeon_side.build import build_surgeon
from tis.surgeon_side.screen import build_screen


def refuse_in_virtual_time(scenario: Scenario) -> None:
    """Raise `InputError` for a scenario of which some part exists in real time only."""
    refused = virtual_time_faults(f"scenario {scenario.name}", scenario)
    if refused:
        raise InputError(refused)


def build_sides(
    scenario: Scenario,
    notes: Sequence[ControlNote] = (),
    kept: Mapping[str, bytes] | None = None,
    recording: Recording | None = None,
) -> tuple[dict[Side, Node], tuple[ArmModel, ...], Sequence[str]]:
    """Return the three nodes, the models, and warnings; raises `InputError` and `DataError`, and writes nothing.

    ``notes`` are the changes of a live run's network to repeat, ``kept`` the attachments of its netem's log,
    ``recording`` the scenario's recording if it is loaded already.
    """
    refuse_in_virtual_time(scenario)
    check_plant(scenario)
    check_codec(scenario)
    own = own_estimators(scenario)  # first: faults are reported before any slow step
    recording = recording or load_recording(scenario)
    models = models_for(scenario, recording)
    nodes: dict[Side, Node] = {
        "surgeon": build_surgeon(scenario, recording),
        "netem": with_live_changes(build_netem(scenario, load_traces(scenario.network, kept)), notes),
        "patient": build_patient(scenario, models, recording, own=factories(own)),
    }
    return nodes, models, warnings_at_start(scenario, recording, models)


def run_twin(
    scenario: Scenario,
    nodes: dict[Side, Node],
    models: Sequence[ArmModel],
    run_dir: Path,
    recording: Recording | None = None,
    on_time: Callable[[int], None] | None = None,
) -> None:
    """Run the nodes to the end of the drain; write their logs to ``run_dir``.

    The models are attached to the patient's log, the provenance of ``recording`` to the logs of both sides that read
    it.
    """
    own = own_estimators(scenario)
    metadata = {
        "version": LOG_VERSION,
        "scenario": scenario.name,
        "digest": scenario_io.digest(scenario),
        "mode": "twin",
    }
    with ExitStack() as stack:
        logs: dict[Side, Recorder] = {}
        for side in nodes:
            about = {**metadata, "side": side}
            log = stack.enter_context(McapLog(run_dir / f"{side}.mcap", about, FLUSH_EVERY_NS))
            log.attach(folder.SCENARIO_FILE, scenario_io.dump_scenario(scenario).encode())
            if side == "netem":
                for name, content in trace_attachments(scenario.network).items():
                    log.attach(name, content)
            if side == "patient":
                for name, content in model_attachment(models).items():
                    log.attach(name, content)
                if own:
                    log.attach(USER_CODE_FILE, dump_origins(origins(own)))
            if side != "netem" and recording is not None:
                log.attach(RECORDING_FILE, dump_played(recording, scenario.n_samples).encode())
            logs[side] = log
        drive(scenario, nodes, logs, on_time)


def drive(
    scenario: Scenario,
    nodes: Mapping[Side, Node],
    logs: Mapping[Side, Recorder],
    on_time: Callable[[int], None] | None = None,
) -> None:
    """Run the nodes in virtual time to the end of the drain; each side's records go to its log.

    ``on_time`` is told the run time about once for each second of it.
    """
    clock = VirtualClock()  # advanced by the bus from event to event
    # netem first: what it releases at an instant is there for the ticks of that instant, as live
    in_order = sorted(nodes.items(), key=lambda one: one[0] != "netem")
    seated = [*in_order, *sight_of(scenario, nodes)]
    seats = [Seat(node, logs[side]) for side, node in seated]
    with without_collector():
        bus = VirtualBus([node for _, node in seated], clock)
        run(seats, bus, clock, scenario.end_ns, _telling(clock, on_time))


def sight_of(scenario: Scenario, nodes: Mapping[Side, Node]) -> list[tuple[Side, Node]]:
    """Return the camera and the screen, each with the side whose log it writes; none without sight."""
    patient = nodes["patient"]
    if scenario.sight is None or not isinstance(patient, PatientNode):
        return []
    hands = [hand.channels for hand in patient.hands]
    return [("patient", build_camera(scenario, hands)), ("surgeon", build_screen(scenario))]


def _telling(clock: VirtualClock, on_time: Callable[[int], None] | None) -> Callable[[], bool]:
    """Return what the loop asks between its steps, by which ``on_time`` is told; it never ends the loop."""
    told_ns = 0

    def never() -> bool:
        nonlocal told_ns
        now_ns = clock.now_ns()
        if on_time is not None and now_ns - told_ns >= NS_PER_S:
            told_ns = now_ns
            on_time(now_ns)
        return False

    return (lambda: False) if on_time is None else never
