"""Page of ``summary.json``: the keys of a twin's summary, and their meaning.

The words are in ``summary_keys.yaml``, by section and path. A key without words, or words without a key, fail the
build; the keys that only live runs have are held against one by ``tests/docs/test_summary_keys.py``.
"""

import json
import re
import tempfile
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any, Final

import yaml
from rich.console import Console

from from_code.markdown import code, prose, table, unit_of
from from_code.sources import Outputs, resolve, run_virtual

WORDS: Final = Path(__file__).with_name("summary_keys.yaml")
_SETTINGS: Final = ("estimators=[hold,innovations_kf]", "identification.order=2")  # what takes least time
_DURATION_S: Final = 6.0
_STATISTICS: Final = frozenset({"mean", "std", "rms", "last", "p50", "p90", "p95", "p99", "p99.9", "max"})
_MARK: Final = re.compile(r"\[(live|two hands|own|device|arm)\] ")
_WHERE: Final = {
    "live": "Live runs",
    "two hands": "Two hands",
    "own": "Own estimators",
    "device": "Devices of others",
    "arm": "Arms that execute",
}
_NAMES: Final = {
    "links": "DIRECTION", "links.DIRECTION.dropped_by": "REASON", "accuracy": "ESTIMATOR", "error_by_age": "HAND",
    "error_by_age.HAND": "ESTIMATOR", "orientation_deg": "HAND", "orientation_deg.HAND": "METHOD",
    "gripper_rad": "HAND", "gripper_rad.HAND": "METHOD", "orientation_by_age": "HAND",
    "orientation_by_age.HAND": "METHOD", "surgeon_traffic": "KEY", "own_estimators": "NAME",
    "quarantined": "KIND", "refused": "KIND", "rejected": "SIDE", "logs": "SIDE", "processors": "SIDE",
    "devices": "HAND", "devices.HAND.refused": "REASON", "external_arms": "HAND",
    "external_arms.HAND.refused": "REASON", "clocks": "SIDE", "safety": "HAND", "safety.HAND.time_s": "MODE",
    "display": "HAND",
}  # fmt: skip
"""Kind of thing that the keys of a mapping name, by the mapping's path."""

_WHOLE: Final = (
    "links.DIRECTION.keys", "links.DIRECTION.conditions.states_s", "links.DIRECTION.verdict.undecided",
    "accuracy_by_hand", "identification_by_hand", "uncertainty_ms", "clocks.SIDE.discipline",
    "orientation_deg.HAND.METHOD.nees", "gripper_rad.HAND.METHOD.nees",
    "own_estimators.NAME.beside", "own_estimators.NAME.first_fault",
)  # fmt: skip
"""Mappings that are explained as a whole."""

_HEAD: Final = """# summary.json

The figures of a run. The keys are an interface: they keep their meaning from version to version. The tables are made
from the summary of a twin. Capitals stand for names: of a direction (`forward`, `feedback`), a hand, an estimator, a
side, a key. *Statistics* are an object with the keys listed. `null` stands for a figure that cannot be known, such as
one of a log that is missing.
"""

Types = dict[str, set[str]]


def page() -> str:
    """Return the page; raises `LookupError` when keys and words differ."""
    sections: Mapping[str, Mapping[str, str]] = yaml.safe_load(WORDS.read_text(encoding="utf-8"))
    found = types_of(_summary())
    differences = (
        undescribed(found) | {path for path, text in words().items() if not _MARK.match(text)} - found.keys()
    )
    if differences:
        raise LookupError(f"summary.json and {WORDS.name} differ in {', '.join(sorted(differences))}")
    parts = [_HEAD]
    for title, of in sections.items():
        rows = (_row(path, text, found.get(path, set())) for path, text in of.items())
        parts += [f"## {title}", "", table(("key", "type", "unit", "meaning"), rows), ""]
    return "\n".join(parts)


def words() -> dict[str, str]:
    """Return the explanation of each path."""
    sections = yaml.safe_load(WORDS.read_text(encoding="utf-8"))
    return {path: text for of in sections.values() for path, text in of.items()}


def undescribed(found: Types) -> set[str]:
    """Return the paths that no words explain."""
    return found.keys() - words().keys()


def types_of(summary: Mapping[str, Any]) -> Types:
    """Return the types met at each path of a summary."""
    found: Types = {}
    _collect(summary, "", found)
    return found


def _collect(value: Any, path: str, found: Types) -> None:
    is_mapping = isinstance(value, Mapping) and path not in _WHOLE
    if is_mapping and value and not value.keys() <= _STATISTICS:
        for key, below in value.items():
            _collect(below, f"{path}.{_NAMES.get(path, key)}".removeprefix("."), found)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for one in value:
            _collect(one, f"{path}[]", found)
    elif not (is_mapping and not value and path not in words()):
        found.setdefault(path, set()).add(_type(value))


def _type(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"statistics: {', '.join(value)}" if value and value.keys() <= _STATISTICS else "object"
    if isinstance(value, list):
        return f"list of {_type(value[0])}" if value else "list"
    return {bool: "boolean", int: "integer", float: "number", str: "text"}.get(type(value), "null")


def _row(path: str, text: str, types: set[str]) -> tuple[str, str, str, str]:
    mark = _MARK.match(text)
    only = f"{_WHERE[mark[1]]}. " if mark else ""
    longer = {one for one in types if one.startswith("list of ")}
    shown = " or ".join(sorted(types - {"list"} if longer else types))
    last = path.rpartition(".")[2]
    unit = unit_of(last) or next((unit_of(one) for one in reversed(path.split(".")[:-1]) if unit_of(one)), "")
    return (
        code(path),
        shown,
        "" if shown in ("text", "boolean", "integer") and not unit_of(last) else unit,
        only + prose(text[mark.end() :] if mark else text),
    )


def _summary() -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        run_dir, quiet = Path(folder) / "run", Console(file=StringIO())
        scenario = resolve("default", _SETTINGS, None, _DURATION_S)
        run_virtual(scenario, run_dir, None, quiet, quiet, Outputs(report=False, merge=False))
        summary: dict[str, Any] = json.loads((run_dir / "summary.json").read_text(encoding="utf-8"))
    return summary
