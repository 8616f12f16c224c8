"""Commands that run a single side: `surgeon`, `netem`, `patient`."""

from importlib import import_module
from pathlib import Path

import typer

from common.channels import Side
from common.runtime.side import SideOptions
from common.runtime.side_cli import RunSide, side_command
from common.runtime.status import Status
from common.scenario import Scenario
from common.scenario.network import NetworkPart
from deploy.net.library.profiles import library
from deploy.run.resolve import scenario_path
from netem.bridge.command import netem_command

app = typer.Typer()


def _close_folder(run_dir: Path, network: NetworkPart, exit_code: int) -> None:
    """Complete the folder of a standalone netem; the import is deferred to this call."""
    from deploy.standalone.command import close_folder

    close_folder(run_dir, network, exit_code)


def _side_of(side: Side, module: str) -> RunSide:
    """Return the function that runs one side; the side's module is imported on the first call."""

    def run_side(scenario: Scenario, options: SideOptions, status: Status) -> int:
        code: int = getattr(import_module(module), f"run_{side}")(scenario, options, status)
        return code

    return run_side


app.command("surgeon")(side_command("surgeon", _side_of("surgeon", "surgeon_side.__main__"), scenario_path, library))
app.command("netem")(netem_command(_side_of("netem", "netem.__main__"), scenario_path, library, _close_folder))
app.command("patient")(side_command("patient", _side_of("patient", "patient_side.__main__"), scenario_path, library))
