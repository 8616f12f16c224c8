"""User-defined code by its name, ``module:factory``: its origin, and its import, as usual the current folder first.

Loading executes the module. It happens only for scenarios with such a name. The origin is the code's file, the digest
of its content, and its version.
"""

import difflib
import hashlib
import importlib
import importlib.metadata
import inspect
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from pydantic import TypeAdapter

from tis.common.errors import DataError, Fault, InputError, one_line, place_of
from tis.common.runtime.process import PACKAGES

USER_CODE_FILE: Final = "estimators.json"
"""Attachment of the patient's log with the origin of user-defined estimators."""

_INSTALLED: Final = ("site-packages", "dist-packages")


@dataclass(frozen=True)
class Origin:
    """Origin of code: its file without the folder, and the digest of its content.

    ``beside`` holds the SHA-256 of the other modules that were loaded from the same folder or package, by file;
    ``distribution`` and ``version`` are those of an installed package, else None.
    """

    file: str | None
    sha256: str | None
    beside: Mapping[str, str]
    distribution: str | None = None
    version: str | None = None

    def changes(self, before: "Origin") -> tuple[str, ...]:
        """Return the differences from ``before``, each as a sentence."""
        found = []
        if self.file != before.file:
            found.append(f"it came from {before.file}, and is {self.file} now")
        elif self.sha256 != before.sha256:
            found.append(f"{self.file} has changed")
        both = {**before.beside, **self.beside}
        found += [
            f"{name}, beside it, has changed"
            for name in sorted(both)
            if before.beside.get(name) != self.beside.get(name)
        ]
        if self.version != before.version:
            name = self.distribution or before.distribution
            found.append(f"{name} was {before.version}, and is {self.version} now")
        return tuple(found)


@cache
def _origins() -> TypeAdapter[dict[str, Origin]]:
    return TypeAdapter(dict[str, Origin])


def dump_origins(origins: Mapping[str, Origin]) -> bytes:
    """Return the origins of user-defined code as JSON, by name."""
    return json.dumps({name: asdict(origin) for name, origin in origins.items()}, indent=1).encode()


def parse_origins(data: bytes, where: str) -> dict[str, Origin]:
    """Return the origins in a text of `dump_origins`; raises `DataError`."""
    try:
        return _origins().validate_json(data)
    except ValueError:
        raise DataError(Fault(where, USER_CODE_FILE, "cannot be read")) from None


def origin_of(name: str, factory: Callable[..., Any]) -> Origin:
    """Return the origin of a factory: the module that ``name`` gives, or the module beside it that defines it."""
    named = sys.modules[name.partition(":")[0]]
    beside = _beside(named)
    plain = isinstance(factory, type) or inspect.isfunction(factory)
    written_in = factory.__module__ if plain else named.__name__
    module = written_in if written_in in beside else named.__name__
    labels = {each: label for each, (label, _) in beside.items()}
    if module not in beside:
        return Origin(None, None, {})
    others = {label: sha256 for each, (label, sha256) in beside.items() if each != module}
    return Origin(labels[module], beside[module][1], dict(sorted(others.items())), *_distribution(named))


def _beside(module: ModuleType) -> dict[str, tuple[str, str]]:
    """Return label and SHA-256 of a module's file and of those beside it, by module.

    These are the loaded modules of its package, or of its folder if it is in no package; modules without a readable
    file are omitted.
    """
    top = module.__name__.partition(".")[0]
    in_package = "." in module.__name__ or hasattr(module, "__path__")
    folder = Path(getattr(module, "__file__", None) or ".").resolve().parent
    found = {}
    resolved = cache(Path.resolve)  # thousands of modules lie in few folders
    for name, other in list(sys.modules.items()):
        file = getattr(other, "__file__", None)
        if not file or name in ("__main__", "__mp_main__"):
            continue
        path = Path(file)
        if in_package:
            beside = name.partition(".")[0] == top
        else:
            where = path.resolve().parent if path.is_symlink() else resolved(path.parent)
            beside = where == folder and folder.name not in _INSTALLED
        if other is not module and not beside:
            continue
        path = path.resolve()
        with suppress(OSError):  # for instance within an archive
            inside = name.replace(".", "/")
            label = f"{inside}{'/__init__' if hasattr(other, '__path__') else ''}{path.suffix}"
            found[name] = (label, hashlib.sha256(path.read_bytes()).hexdigest())
    return found


def _distribution(module: ModuleType) -> tuple[str | None, str | None]:
    """Return name and version of the distribution that installed a module, None if none did."""
    installed = any(part in _INSTALLED for part in Path(module.__file__ or "").parts)
    for name in _distributions().get(module.__name__.partition(".")[0], ()):
        found = importlib.metadata.distribution(name)
        # the files of an editable installation lie outside site-packages
        if installed or '"editable": true' in (found.read_text("direct_url.json") or ""):
            return name, found.version
    return None, None


@cache
def _distributions() -> Mapping[str, list[str]]:
    return importlib.metadata.packages_distributions()  # slow: it reads the list of every installed file


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
    now = ""
    if isinstance(error, ModuleNotFoundError) and find_spec(f"tis.{(error.name or '').partition('.')[0]}"):
        now = f", it has become 'tis.{error.name}'"
    # the message of a syntax error contains the line
    place = "" if isinstance(error, SyntaxError) else place_of(error, __file__, importlib.__file__)
    return f"{name} cannot be imported: {one_line(error)}{now}{place}"


def _file_name(found: Any) -> str | None:
    """Return a module's file without its folder, or the name of a package or class."""
    if hasattr(found, "__path__"):
        return str(found.__name__)
    file = getattr(found, "__file__", None)
    return Path(file).name if file else getattr(found, "__qualname__", None)
