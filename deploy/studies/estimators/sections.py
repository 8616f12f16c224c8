"""Sections of ``docs/research/estimators.md``: requests and their explanations, read from ``sections.yaml``."""

import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

import yaml

from tis.common.runtime.recordings import list_trials
from tis.common.runtime.recordings.jigsaws import JIGSAWS_VARIABLE
from tis.common.scenario.estimator_names import EstimatorName, is_learned
from tis.common.scenario.source import JigsawsSource
from tis.deploy.compare.grid import parse_sweep
from tis.deploy.compare.plan import Request

NAMES: Final = get_args(EstimatorName)
_COMPARED: Final = tuple(name for name in NAMES if name != "adaptive_kf" and not is_learned(name))
"""Estimators of the large tables; the adaptive one has tables of its own, the learned ones a page (`tis paper`)."""
_ESTIMATORS: Final = {
    "all": _COMPARED,
    "few": tuple(name for name in _COMPARED if name not in ("static_gain", "n4sid_kf", "paper_as_printed")),
}
"""Few are those without the ones that differ little from others, or much from all."""
_FILE: Final = Path(__file__).with_name("sections.yaml")
Shows = Literal["errors", "redundancy", "paper", "ages", "orientation"]


@dataclass(frozen=True)
class Section:
    """Section of the page: request and explanation; ``shows`` selects the tables besides errors and cost."""

    title: str
    about: str
    request: Request
    shows: Shows


def sections() -> list[Section]:
    """Return the page's sections: on synthetic movement, and on recorded trials if available."""
    raw = yaml.safe_load(_FILE.read_text(encoding="utf-8"))
    found = []
    for name, source in raw["sources"].items():
        last: tuple[str, ...] | None = None
        if name != "synthetic":
            if not os.environ.get(JIGSAWS_VARIABLE):
                continue
            last = _one_of_each_person(list_trials(JigsawsSource(kind="jigsaws", task="Suturing")))
        found += [_section(each, name, source, last) for each in raw["sections"] if each.get("of", name) == name]
    return found


def _section(raw: dict[str, Any], name: str, source: dict[str, Any], last: tuple[str, ...] | None) -> Section:
    names = raw["estimators"]
    request = Request(
        "default",
        (*source["set"], *raw["set"]),
        _ESTIMATORS[names] if isinstance(names, str) else tuple(names),
        None if raw.get("trials") == "all" else last,
        n_seeds=source.get("seeds"),
        duration_s=source.get("duration_s"),
        sweeps=(parse_sweep(raw["sweep"]),),
    )
    return Section(raw["title"].format(source=name), raw["about"], request, raw["shows"])


def _one_of_each_person(trials: Sequence[str]) -> tuple[str, ...] | None:
    return tuple({name[0]: name for name in trials}.values()) or None


def command_of(request: Request) -> str:
    """Return the command that repeats a request."""
    options: list[tuple[str, object]] = [
        ("--estimators", ",".join(request.estimators or ())),
        ("--trials", ",".join(request.trials or ())),
        ("--seeds", request.n_seeds),
        ("--duration-s", None if request.duration_s is None else f"{request.duration_s:g}"),
        *(("--sweep", f"{sweep.path}={','.join(sweep.values)}") for sweep in request.sweeps),
        *(("--set", setting) for setting in request.settings),
    ]
    words = [word for option, value in options if value for word in (option, str(value))]
    return shlex.join(["tis", "compare", request.scenario, *words])
