"""The surgeon's process: ``python -m surgeon_side SCENARIO`` or ``tis surgeon SCENARIO``."""

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
from tis.common.scenario import Scenario, check_foreign_surgeon
from tis.common.sight.codec import check_codec
from tis.common.sources.provenance import RECORDING_FILE, dump_played
from tis.surgeon_side.build import build_surgeon, build_witness


def run_surgeon(scenario: Scenario, options: SideOptions, status: Status) -> int:
    """Run the surgeon's side to its end; return the exit code."""
    connect = options.zenoh.connect or endpoints_for(scenario, "surgeon", "west")
    options = replace(options, zenoh=replace(options.zenoh, connect=connect))

    def prepare() -> Prepared:
        if options.witness:
            check_foreign_surgeon(f"scenario {scenario.name}", scenario.source)
        check_codec(scenario)
        recording = load_movement(scenario)
        played = {RECORDING_FILE: dump_played(recording, scenario.n_samples).encode()}
        warnings = [*recording.warnings, *scenario.surgeon.warnings()]
        node = build_witness(scenario, recording) if options.witness else build_surgeon(scenario, recording)
        beside = None if scenario.sight is None else Beside("tis.surgeon_side.screen:build_screen", "west")
        return Prepared(node, played, warnings, scenario.source.device_keys, beside)

    return run_client_side("surgeon", "west", scenario, options, prepare, status)


command = side_command("surgeon", run_surgeon)

if __name__ == "__main__":
    run_to_end(lambda: typer.run(command))
