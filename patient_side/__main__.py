"""The patient's process: ``python -m patient_side SCENARIO`` or ``tis patient SCENARIO``."""

import time
from dataclasses import replace

import typer

from tis.common.runtime.client_side import run_client_side
from tis.common.runtime.companion import Beside
from tis.common.runtime.process import run_to_end
from tis.common.runtime.recordings import load_movement
from tis.common.runtime.side import Prepared
from tis.common.runtime.side_cli import endpoints_for, side_command
from tis.common.runtime.side_log import SideOptions
from tis.common.runtime.status import Status
from tis.common.runtime.user_code import USER_CODE_FILE, dump_origins
from tis.common.scenario import Scenario
from tis.common.sight.codec import check_codec
from tis.common.sources.provenance import RECORDING_FILE, dump_played
from tis.patient_side.build import build_patient
from tis.patient_side.models import factories, model_attachment, models_for, origins, own_estimators
from tis.patient_side.plant.physics import check_plant
from tis.patient_side.provenance import warnings_at_start


def run_patient(scenario: Scenario, options: SideOptions, status: Status) -> int:
    """Run the patient's side to its end; return the exit code."""
    connect = options.zenoh.connect or endpoints_for(scenario, "patient", "east")
    options = replace(options, zenoh=replace(options.zenoh, connect=connect))

    def prepare() -> Prepared:
        # first: their faults are reported before the slow identification
        scenario.identification.check_for_live_runs(scenario.estimators)
        check_plant(scenario)
        if scenario.sight is not None and not scenario.sight.is_external:  # which encodes by itself
            check_codec(scenario)
        own = own_estimators(scenario)
        recording = load_movement(scenario)
        models = models_for(scenario, recording)
        node = build_patient(scenario, models, recording, time.perf_counter_ns, factories(own))
        played = dump_played(recording, scenario.n_samples).encode()
        attachments = {**model_attachment(models), RECORDING_FILE: played}
        attachments |= {USER_CODE_FILE: dump_origins(origins(own))} if own else {}
        warnings, beside = warnings_at_start(scenario, recording, models), None
        if scenario.sight is not None:
            hands = [(hand.hand, hand.arm) for hand in recording.hands]
            builder = "external_camera:build_external_camera" if scenario.sight.is_external else "camera:build_camera"
            beside = Beside(f"tis.patient_side.{builder}", "east", hands)
        return Prepared(node, attachments, warnings, node.foreign_keys(), beside)

    return run_client_side("patient", "east", scenario, options, prepare, status)


command = side_command("patient", run_patient)

if __name__ == "__main__":
    run_to_end(lambda: typer.run(command))
