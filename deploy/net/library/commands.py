"""Commands ``tis net profiles`` and ``tis net stages``: the library, and the reference of all kinds of stages."""

import json
from pathlib import Path
from typing import Any, get_args

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tis.common.channels import Direction
from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario.profile import Profile
from tis.deploy.net.library.profiles import find_profile, shipped_names
from tis.deploy.net.library.stage_reference import Kind, network_page, sections
from tis.deploy.net.terminal import Figures, print_library, print_profile
from tis.deploy.shell import run_dir as folder
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


def print_stages(name: str | None, out: Console) -> int:
    """Print one line per kind, or one section with every parameter; raises `InputError` for an unknown name."""
    found = {section.name: section for section in sections()}
    if name is None:
        table = Table(box=None, padding=(0, 2, 0, 0))
        for heading in ("stage", "kind", "parameters, [optional]"):
            table.add_column(heading, overflow="fold", no_wrap=heading != "parameters, [optional]")
        for section in found.values():
            for place, kind in enumerate(section.kinds):
                table.add_row(section.name if place == 0 else "", kind.name, escape(_brief(kind)))
        out.print(table)
        out.print(
            "Stages act from the top down to ordering. `tis net stages NAME` explains one, `--out PAGE.md` all."
        )
        return EXIT_OK
    if name not in found:
        raise InputError(Fault("tis net stages", "NAME", f"must be one of {', '.join(found)}", name))
    out.print(escape(f"{name}: {found[name].meaning}"), soft_wrap=True)
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("kind", "parameter", "values", "default", "meaning"):
        table.add_column(heading, overflow="fold")
    for kind in found[name].kinds:
        for place, one in enumerate(kind.parameters):
            default = "required" if one.required else one.default
            cells = (kind.name if place == 0 else "", one.name, one.values, default, one.meaning)
            table.add_row(*map(escape, cells))
    out.print(table)
    return EXIT_OK


def write_page(target: Path, out: Console) -> int:
    """Write the reference as a page; raises `DataError`."""
    folder.write(target, network_page())
    out.print(escape(str(target)), soft_wrap=True)
    return EXIT_OK


def _brief(kind: Kind) -> str:
    names = dict.fromkeys((one.name, one.required) for one in kind.parameters)
    return ", ".join(name if required else f"[{name}]" for name, required in names)
