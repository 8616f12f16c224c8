"""User-defined code by its name, ``module:factory``: imported as usual, the current folder first.

Loading executes the module. It happens only for scenarios with such a name.
"""

import difflib
import importlib
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from tis.common.errors import Fault, InputError, one_line
from tis.common.runtime.child_process import PACKAGES
from tis.common.runtime.code_origin import Origin, origin_of


@dataclass(frozen=True)
class UserCode:
    """The factory of a name, and its origin."""

    factory: Callable[..., Any]
    origin: Origin


def load_user_code(names: Sequence[str], where: str) -> dict[str, UserCode]:
    """Return the factory of each ``module:factory``; raises `InputError` with the faults of all.

    The current folder is added to ``sys.path`` and stays there, so that child processes find the same modules.
    Oracle: modules that tests write (test_user_code).
    """
    if not names:
        return {}
    here = str(Path.cwd())
    if here not in sys.path and "" not in sys.path:
        # behind Python's own modules, before the folder of the testbed: in a checkout that holds packages of common
        # names
        sys.path.insert(sys.path.index(PACKAGES) if PACKAGES in sys.path else len(sys.path), here)
    importlib.invalidate_caches()  # a file may be newer than the cached listing of its folder
    found: dict[str, Callable[..., Any]] = {}
    faults = []
    for name in names:
        try:
            found[name] = _found(name)
        except _Refused as refused:
            faults.append(Fault(where, name, str(refused)))
    if faults:
        raise InputError(faults)
    # After all are loaded, so that the modules beside one do not depend on the order of loading.
    return {name: UserCode(factory, origin_of(name, factory)) for name, factory in found.items()}


class _Refused(Exception):  # noqa: N818  it becomes an error only together with the others
    pass


def _found(name: str) -> Callable[..., Any]:
    module_name, _, path = name.partition(":")
    found: Any = _module(module_name)
    for part in path.split("."):
        try:
            found = getattr(found, part)
        except Exception:  # a module may define __getattr__
            near = difflib.get_close_matches(part, [one for one in dir(found) if not one.startswith("__")], n=2)
            hint = f", did you mean {' or '.join(map(repr, near))}?" if near else ""
            raise _Refused(f"{_file_name(found) or module_name} has no {part!r}{hint}") from None
    if not callable(found):
        kind = type(found).__name__
        raise _Refused(f"must be a class or a function that takes the arm's model; {path} is of type {kind}")
    factory: Callable[..., Any] = found
    return factory


def _module(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        # The module itself or a package above it is missing; otherwise one of its own imports failed.
        if name == missing or name.startswith(f"{missing}."):
            what = f"no module {missing!r}" if name == missing else f"no package {missing!r} of {name!r}"
            raise _Refused(f"{what}, neither in the current folder nor on Python's search path") from None
        raise _Refused(_import_failed(name, error)) from None
    except (Exception, SystemExit) as error:
        raise _Refused(_import_failed(name, error)) from None


def _import_failed(name: str, error: BaseException) -> str:
    """Return the error of an import, with the last line of user code in its traceback."""
    place, now = "", ""
    if isinstance(error, ModuleNotFoundError) and find_spec(f"tis.{(error.name or '').partition('.')[0]}"):
        now = f", it has become 'tis.{error.name}'"
    if not isinstance(error, SyntaxError):  # its message contains the line
        frames = [one for one in traceback.extract_tb(error.__traceback__) if not _is_importing(one.filename)]
        place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{name} cannot be imported: {one_line(error)}{now}{place}"


def _is_importing(filename: str) -> bool:
    return filename.startswith("<frozen") or filename in (__file__, importlib.__file__)


def _file_name(found: Any) -> str | None:
    """Return a module's file without its folder, or the name of a package or class."""
    if hasattr(found, "__path__"):
        return str(found.__name__)
    file = getattr(found, "__file__", None)
    return Path(file).name if file else getattr(found, "__qualname__", None)
