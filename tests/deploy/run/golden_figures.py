"""Figures of the shipped scenarios' twins, kept in files, so that a change that should change none shows what it did.

``python -m tests.deploy.run.golden_figures`` makes the files anew, for a change that means to change figures.
"""

import json
from collections.abc import Iterator, Mapping
from math import isclose
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.shipped_scenarios import shipped_names

FOLDER: Final = Path(__file__).parent / "goldens"
TOLERANCE: Final = 1e-9
"""Relative and absolute: on processors with other vector units figures differ by up to 1e-12."""
_LEFT_OUT: Final = frozenset(
    {"verdicts", "logs", "processors", "clocks", "recording", "command", "run_id", "surgeon_traffic", "redundancy"}
) | {"kbit_s", "quality"}
"""Prose, what tells of the machine or the version, bytes of payloads, which hang on last digits, and of a codec."""
_WHOLE_FRAMES: Final = (
    "sight.fragment_bytes=65000",
    "network.feedback.rate=null",
    "network.feedback.loss.p_loss=0.1",
)
"""A frame is one message of no matter how many bytes, so that no other figure hangs on the version of a codec."""


FAST: Final = ("kilohertz", "touch", "touch_unstable")
"""Scenarios of 1000 ticks a second."""


def names() -> list[str]:
    """Return the shipped scenarios that run as twins and need no recordings, but for touch beside sight."""
    all_of_them = {name: resolve(name) for name in shipped_names()}
    return [
        name
        for name, one in all_of_them.items()
        if one.source.kind == "synthetic" and (one.sight is None or one.touch is None)
    ]


def short(name: str) -> Scenario:
    """Return a shipped scenario of some seconds: enough for scores, and for the outage to begin."""
    return resolve(name, _WHOLE_FRAMES if name == "sight" else (), None, 2.4 if name in FAST else 5.0)


def figures(value: Any) -> Any:
    """Return numbers, yes and no, and what is not known, without texts."""
    if isinstance(value, Mapping):
        return {key: figures(one) for key, one in value.items() if key not in _LEFT_OUT and not isinstance(one, str)}
    if isinstance(value, list):
        return [figures(one) for one in value if not isinstance(one, str)]
    return value


def differences(kept: Any, found: Any, path: str = "") -> Iterator[str]:
    """Yield each figure that differs, with both values."""
    if isinstance(kept, dict) and isinstance(found, dict):
        for key in sorted(kept.keys() | found.keys()):
            yield from differences(kept.get(key, "absent"), found.get(key, "absent"), f"{path}.{key}".lstrip("."))
    elif isinstance(kept, list) and isinstance(found, list) and len(kept) == len(found):
        for i, (one, other) in enumerate(zip(kept, found, strict=True)):
            yield from differences(one, other, f"{path}[{i}]")
    elif not _is_same(kept, found):
        yield f"{path}: {kept} -> {found}"


def _is_same(kept: Any, found: Any) -> bool:
    numbers = (int, float)
    if type(kept) is not bool and isinstance(kept, numbers) and isinstance(found, numbers):
        return isclose(kept, found, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    return type(kept) is type(found) and bool(kept == found)


def kept(name: str) -> Any:
    """Return the figures in a scenario's file."""
    return json.loads((FOLDER / f"{name}.json").read_text())


def main() -> None:
    """Make all files anew."""
    with TemporaryDirectory() as where:
        for name in names():
            scenario, run_dir = short(name), Path(where) / name
            folder.create(run_dir, scenario)
            nodes, models, _ = build_sides(scenario)
            run_twin(scenario, nodes, models, run_dir)
            found = figures(build_summary(load_run(run_dir), scenario, models, "twin", 0, ""))
            lines = (f" {json.dumps(key)}: {json.dumps(one)}" for key, one in sorted(found.items()))
            (FOLDER / f"{name}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
