"""Commands that run a single side: `surgeon`, `netem`, `patient`."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.runtime.side_cli import side_command
from deploy.cli.group import Commands
from netem.bridge.command import netem_command

if TYPE_CHECKING:  # what a run needs takes long to import: only when it runs, not for the help
    from common.channels import Side
    from common.runtime.side_cli import RunSide
    from common.runtime.side_log import SideOptions
    from common.runtime.status import Status
    from common.scenario import Scenario
    from common.scenario.network import NetworkPart

app = Commands("One side, on a host of its own")


def _scenario_path(name: str) -> Path:
    from deploy.run.resolve import scenario_path

    return scenario_path(name)


def _library(name: str) -> Mapping[str, Any]:
    from deploy.net.library.profiles import library

    return library(name)


def _close_folder(run_dir: Path, network: "NetworkPart", exit_code: int) -> None:
    """Complete the folder of a standalone netem."""
    from deploy.standalone.command import close_folder

    close_folder(run_dir, network, exit_code)


def _side_of(side: "Side", module: str) -> "RunSide":
    """Return the function that runs one side."""

    def run_side(scenario: "Scenario", options: "SideOptions", status: "Status") -> int:
        code: int = getattr(import_module(module), f"run_{side}")(scenario, options, status)
        return code

    return run_side


app.command("surgeon")(
    side_command("surgeon", _side_of("surgeon", "surgeon_side.__main__"), _scenario_path, _library)
)
app.command("netem")(netem_command(_side_of("netem", "netem.__main__"), _scenario_path, _library, _close_folder))
app.command("patient")(
    side_command("patient", _side_of("patient", "patient_side.__main__"), _scenario_path, _library)
)
