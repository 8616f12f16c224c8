"""Command ``tis net profiles``."""

import json
from typing import Any, get_args

from rich.console import Console

from tis.common.channels import Direction
from tis.common.errors import EXIT_OK
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario.profile import Profile
from tis.deploy.net.library.profiles import find_profile, shipped_names
from tis.deploy.net.terminal import Figures, print_library, print_profile
from tis.netem.expected.figures import direction_figures


def list_profiles(out: Console, as_json: bool) -> int:
    """Print every profile of the library with its figures."""
    rows = [(profile, figures_of(profile)) for profile in map(find_profile, shipped_names())]
    if as_json:
        print(json.dumps({profile.name: _plain(profile, figures) for profile, figures in rows}, indent=1))  # noqa: T201
    else:
        print_library(rows, out)
    return EXIT_OK


def show_profile(name: str, out: Console, as_json: bool) -> int:
    """Print one profile with its numbers and sources."""
    profile = find_profile(name)
    figures = figures_of(profile)
    if as_json:
        whole = profile.model_dump(mode="json", exclude={"network"}) | {"network": profile.partial()}
        print(json.dumps(whole | _plain(profile, figures), indent=1))  # noqa: T201
    else:
        print_profile(profile, figures, out)
    return EXIT_OK


def figures_of(profile: Profile) -> Figures:
    """Compute a profile's figures for both directions."""
    traces = load_traces(profile.network)
    return {direction: direction_figures(profile.network, direction, traces) for direction in get_args(Direction)}


def _plain(profile: Profile, figures: Figures) -> dict[str, Any]:
    return {"title": profile.title, "figures": {direction: of._asdict() for direction, of in figures.items()}}
