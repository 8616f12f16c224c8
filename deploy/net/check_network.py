"""``tis validate`` of a network or a profile, as netem would read it."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.scenario_files import load_traces, read_scenario
from tis.common.scenario.file_kind import kind_of
from tis.common.scenario.network import NetworkPart
from tis.deploy.net.profiles import library, read_profile
from tis.deploy.shell.guard import print_json
from tis.netem.bridge.chosen_network import read_network
from tis.netem.bridge.standalone_log import network_yaml
from tis.netem.build import build_links


def check_network(path: Path, settings: Sequence[str], err: Console, as_json: bool) -> int | None:
    """Check a file that holds a network or a profile, and print the network; None for a scenario, which is not read.

    Raises `InputError` and `DataError` with all faults, also those of traces and of rules that tie.
    """
    kind = kind_of(read_scenario(path))
    if kind == "scenario":
        return None
    if kind == "profile":
        if settings:
            raise InputError(Fault("tis validate", "--set", "must not be given for a profile", settings[0]))
        network, use = read_profile(path).network, f"tis netem --profile {path}"
    else:
        _, network = read_network(path, None, list(settings), None, library)
        use = f"tis netem --scenario-network {path}"
    build_links(network, ["**"], 0, load_traces(network), str(path))
    if as_json:
        print_json(network.model_dump(mode="json", exclude_none=True))
    elif network != NetworkPart():
        print(network_yaml(network), end="")  # noqa: T201
    err.print(f"{path}: a {kind}: valid; {use} uses it", highlight=False, markup=False, soft_wrap=True)
    return EXIT_OK
