"""Words that a shell completes: names of scenarios, profiles and estimators, beside files."""

from collections.abc import Iterable, Iterator
from glob import escape
from pathlib import Path


def scenarios(incomplete: str) -> list[str]:
    """Return shipped scenarios, YAML files and folders."""
    from tis.deploy.shell.shipped_scenarios import shipped_names

    return [*_beginning(incomplete, shipped_names()), *_files(incomplete)]


def profiles(incomplete: str) -> list[str]:
    """Return profiles of the library, YAML files and folders."""
    from tis.deploy.net.profiles import shipped_names

    return [*_beginning(incomplete, shipped_names()), *_files(incomplete)]


def estimators(incomplete: str) -> list[str]:
    """Return the list ``A,B,`` with each estimator that it may go on with."""
    from tis.common.estimators import NAMES

    before, comma, last = incomplete.rpartition(",")
    given = before.split(",")
    return [f"{before}{comma}{name}" for name in _beginning(last, NAMES) if name not in given]


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def _files(incomplete: str) -> Iterator[str]:
    """Yield the files and folders of which a path is the beginning."""
    folder, slash, name = incomplete.rpartition("/")
    for path in sorted(Path(folder or slash or ".").glob(f"{escape(name)}*")):
        if path.is_dir() or path.suffix in (".yaml", ".yml"):
            yield f"{folder}{slash}{path.name}{'/' if path.is_dir() else ''}"
