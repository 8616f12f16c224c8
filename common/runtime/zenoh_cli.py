"""Command-line options for Zenoh, common to all commands that connect: ``-c FILE --cfg KEY:VALUE --insecure``."""

from pathlib import Path
from typing import Annotated, Any

import typer

ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", help="Zenoh configuration file (JSON5).")]
CfgOption = Annotated[
    list[str] | None, typer.Option("--cfg", help="Zenoh setting KEY:VALUE, VALUE in JSON5; overrides --config.")
]


def insecure_option(listens: bool = True) -> Any:
    """Return the option that lets everybody connect; hidden where nothing listens."""
    return typer.Option(
        "--insecure",
        hidden=not listens,
        help="Listen beyond loopback although anybody may connect: no certificates, no users.",
    )


InsecureOption = Annotated[bool, insecure_option()]
