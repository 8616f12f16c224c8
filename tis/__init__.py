"""The testbed's one import name, of which `common`, `surgeon_side`, `netem`, `patient_side` and `deploy` are parts.

In a checkout these are links to the folders at the top level, in a wheel the folders themselves.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tis.patient_side.identification.system_identification import identify as identify

if not (Path(__file__).parent / "common").is_dir():
    sys.exit(
        "tis: the symbolic links tis/common and others are missing here: clone the project anew with "
        "`git clone -c core.symlinks=true`, or install its wheel"
    )


def refuse_old_name(name: str) -> None:
    """Raise `ImportError` if a package is imported as the folder ``name``: its classes would then exist twice.

    ``python -m surgeon_side`` in a checkout may: it takes no more than ``__main__`` from the folder.
    """
    if not name.startswith("tis.") and sys.argv[:1] != ["-m"]:
        raise ImportError(f"{name} has become tis.{name}: import it by this name", name=name)


def __getattr__(name: str) -> Any:
    """Return `identify`, the library's function, whose modules load when it is asked for."""
    if name != "identify":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from tis.patient_side.identification.system_identification import identify

    return identify
