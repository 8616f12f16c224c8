"""`tis new`: a commented scenario, and the schema by which editors check and complete it."""

import re
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.process import command_line
from tis.common.scenario import reading
from tis.deploy.shell.run_dir import write
from tis.deploy.shell.shipped_scenarios import shipped_names

SCHEMA_FILE: Final = "scenario.schema.json"
_TEMPLATE: Final = Path(__file__).with_name("new_scenario.yaml")
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def write_new(name: str, out: Console) -> int:
    """Write ``NAME.yaml``, and its schema beside it; raises `InputError` for a bad name and a file that exists.

    ``name`` may have a folder and the suffix ``.yaml``. The schema is written again, for this version of tis.
    """
    path = Path(name)
    path = path if path.suffix in (".yaml", ".yml") else path.with_name(f"{path.name}.yaml")
    faults = []
    if _NAME.fullmatch(path.stem) is None:
        faults.append(
            Fault("tis new", "NAME", "must be letters, digits, - and _, and begin with none of these two", name)
        )
    if path.stem in shipped_names():
        faults.append(
            Fault("tis new", "NAME", f"must not be a shipped scenario's, which `tis run {name}` runs", name)
        )
    if path.exists():
        faults.append(Fault(str(path), "", "exists already and is not replaced"))
    if not path.parent.is_dir():
        faults.append(Fault(str(path.parent), "", "folder does not exist"))
    if faults:
        raise InputError(faults)
    write(path.with_name(SCHEMA_FILE), reading.schema_json() + "\n")
    write(path, _TEMPLATE.read_text(encoding="utf-8").replace("name: NAME", f"name: {path.stem}"))
    run = command_line(["run", str(path)])
    out.print(escape(f"{path} written, and {SCHEMA_FILE}, by which editors check it; run it: {run}"), soft_wrap=True)
    return EXIT_OK
