"""Command ``tis net stages``: the sections as tables, in the terminal or as a page."""

from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.deploy.net.library.network_page import network_page
from tis.deploy.net.library.stage_reference import Kind, sections
from tis.deploy.shell import run_dir as folder


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
