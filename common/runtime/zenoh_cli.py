"""Zenoh's options on a command line, the same for every command that connects: ``-c FILE --cfg KEY:VALUE``."""

from pathlib import Path
from typing import Annotated

import typer

ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", help="Zenoh configuration file (JSON5).")]
CfgOption = Annotated[
    list[str] | None, typer.Option("--cfg", help="Zenoh setting KEY:VALUE, VALUE in JSON5; over --config.")
]
