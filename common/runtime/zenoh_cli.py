"""Command-line options for Zenoh, common to all commands that connect: ``-c FILE --cfg KEY:VALUE``."""

from pathlib import Path
from typing import Annotated

import typer

ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", help="Zenoh configuration file (JSON5).")]
CfgOption = Annotated[
    list[str] | None, typer.Option("--cfg", help="Zenoh setting KEY:VALUE, VALUE in JSON5; overrides --config.")
]
