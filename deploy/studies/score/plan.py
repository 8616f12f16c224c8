"""Plan of a score: the twins of each setting, and the trainings, on other people than those scored."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from tis.common.errors import DataError, Fault
from tis.common.estimators import ESTIMATORS, scenario_name, short_name
from tis.common.runtime.recordings import trial_file
from tis.common.runtime.user_code import UserCode, load_user_code
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import fault_of, is_built_in, is_user_defined
from tis.common.scenario.reading import build_scenario
from tis.common.scenario.source import JigsawsSource
from tis.deploy.compare.cells.cell import Cell, Training
from tis.deploy.compare.cells.identity import (
    cell_of,
    software_digest,
    training_of,
    training_on,
    trial_facts,
    value_digest,
)
from tis.deploy.studies.score import foreign, population, reference
from tis.deploy.studies.score.protocol import NAME, Setting, Track, content, digest, settings

COMMAND: Final = "tis score"
_END_S: Final = 1.0
"""End of each movement that is not played: the last row's stamp may be early."""


class Subject(NamedTuple):
    """What is scored: its name in the row, that in scenarios, and its command where it is a foreign process."""

    name: str
    scenario_name: str
    command: tuple[str, ...] = ()


def subject_of(text: str) -> Subject:
    """Return what an argument names: a shipped estimator, module:factory, or a command; raises `InputError`."""
    if text in ESTIMATORS or is_built_in(text):
        name = short_name(text)
        return Subject(name, scenario_name(name))
    if is_user_defined(text) and fault_of(text) is None:
        return Subject(text, text)
    return Subject(text, foreign.NAME, tuple(foreign.command_of(text, COMMAND)))


@dataclass(frozen=True)
class Work:
    """The twins, each under its setting's name, the trainings by their digest, and the code of own estimators."""

    cells: tuple[Cell, ...]
    trainings: Mapping[str, Training]
    own: Mapping[str, UserCode]


@dataclass(frozen=True)
class Asked:
    """What is asked for; ``place`` is the folder of the movements on the open track, that of JIGSAWS on the other."""

    subjects: tuple[Subject, ...]
    track: Track
    quick: bool
    seed: int
    place: Path | None

    @property
    def trained(self) -> list[str]:
        """The estimators that models are identified for; a foreign process has none here."""
        return list(dict.fromkeys(("hold", *(each.scenario_name for each in self.subjects if not each.command))))

    @property
    def run(self) -> list[str]:
        """The estimators of each twin."""
        return list(dict.fromkeys(("hold", *(each.scenario_name for each in self.subjects), reference.NAME)))


def work_of(asked: Asked) -> Work:
    """Return all twins and trainings; raises `InputError`, and `DataError` where movements lack or differ."""
    own = load_user_code([name for name in asked.run if is_user_defined(name)], COMMAND)
    cells: list[Cell] = []
    trainings: dict[str, Training] = {}
    for setting in settings(asked.track, asked.quick):
        for source, trial, duration_s, training in _movements(asked, setting):
            known = trainings.setdefault(training.digest, training)
            raw = setting.scenario(asked.seed, duration_s, source, asked.run)
            cells.append(cell_of(build_scenario(raw, NAME), setting.name, trial, known, own))
    return Work(tuple(cells), trainings, own)


Movement = tuple[dict[str, Any], str, float, Training]


def _movements(asked: Asked, setting: Setting) -> list[Movement]:
    return _of_the_population(asked, setting) if asked.track == "open" else _recorded(asked, setting)


def _of_the_population(asked: Asked, setting: Setting) -> list[Movement]:
    assert asked.place is not None
    quick = content()["quick"]
    group, training = population.scored(quick["people"] if asked.quick else None), population.trained()
    duration_s = quick["duration_s"] if asked.quick else group.duration_s - _END_S
    files = _tables(asked.place, setting.data, asked.quick, asked.seed)
    names = training.files
    found: list[Movement] = []
    for name in group.files:
        source: dict[str, Any] = {"kind": "table", "path": str(files[name]), "hands": ["left"]}
        source |= {"resample": True} if setting.instants == "restored" else {}
        scenario = _trained_scenario(asked, setting, duration_s, source)
        # One training for all who are scored: none of them is trained on.
        about = (setting.data, setting.instants, setting.noise_mm)
        deciding = [software_digest(), digest(), *about, asked.trained, asked.seed]
        its = Training(value_digest(deciding), f"{NAME}, {setting.name}", scenario, False, tuple(names))
        found.append((source, name, duration_s, its))
    return found


@cache
def _tables(place: Path, data: str, quick: bool, seed: int) -> dict[str, Path]:
    n_people = content()["quick"]["people"] if quick else None
    groups = population.trained(), population.scored(n_people)
    return {file.name: file for group in groups for file in population.write(place, data, group, seed)}


def _recorded(asked: Asked, setting: Setting) -> list[Movement]:
    about = content()["tracks"]["jigsaws"]
    clock = "auto" if setting.instants == "restored" else "as_recorded"
    raw = {"kind": "jigsaws", "task": about["task"], "hands": ["left", "right"], "clock": clock}
    raw |= {} if asked.place is None else {"path": str(asked.place)}
    files = _checked(raw)
    names = list(about["scored"])
    if asked.quick:  # the last trial of each person
        names = list({name[0]: name for name in names}.values())
    found: list[Movement] = []
    for name in names:
        source = raw | {"trial": name}
        whole_s = (trial_facts(files[name]).n_rows - 1) / content()["scenario"]["rate_hz"]
        duration_s = min(content()["quick"]["duration_s"], whole_s) if asked.quick else whole_s
        base = training_of(_trained_scenario(asked, setting, duration_s, source))
        assert base is not None
        others = [other for other in files if other[0] != name[0]]
        its = training_on(base, others, f"{NAME}, all but {name[0]}, {setting.name}")
        found.append((source, name, duration_s, its))
    return found


def _checked(raw: Mapping[str, Any]) -> dict[str, Path]:
    """Return the trials' files, each with the content that the protocol states; raises `DataError`."""
    source = JigsawsSource.model_validate(raw)
    files, faults = {}, []
    for name, expected in content()["tracks"]["jigsaws"]["trials"].items():
        file = files[name] = trial_file(source, name)
        if not file.is_file():
            faults.append(Fault(str(file), "", "does not exist: JIGSAWS is to be had for research on request"))
        elif trial_facts(file).digest != expected:
            faults.append(Fault(str(file), "BLAKE2b-64", f"must be {expected}: another trial, or a changed one"))
    if faults:
        raise DataError(faults)
    return files


def _trained_scenario(asked: Asked, setting: Setting, duration_s: float, source: Mapping[str, Any]) -> Scenario:
    raw = setting.scenario(asked.seed, duration_s, source, asked.trained)
    return build_scenario(raw | {"surgeon": {}}, NAME)
