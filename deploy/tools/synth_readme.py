"""README of a folder of synthetic trials: whose movements they are, and how to play or repeat one."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import yaml

from tis.common.scenario import Scenario
from tis.common.scenario.source import SYNTHETIC_SUBJECTS, SyntheticSource
from tis.common.sources.jigsaws import RATE_HZ
from tis.common.sources.population import SPREAD, person

_TEXT: Final = """\
SYNTHETIC DATA: these movements were computed, not recorded.

The trials {first} to {last} were computed by the synthetic surgeon of tis, with
    {command}
They are no part of JIGSAWS, the JHU-ISI Gesture and Skill Assessment Working Set, and hold nothing copied from it.
They only use its layout: {task}/kinematics/AllGestures/{task}_{first}.txt, 76 columns, {rate_hz} rows a second. The
letters {letter_1} to {letter_n} mark synthetic people; JIGSAWS has none of them.

{whose}
There are no gestures, no skill and no needle in them, whatever the task in the name.

Velocities are central differences of the neighbouring rows' poses (one-sided at both ends), in m/s and rad/s, so they
look one row ahead. Rows lie one or two samples of a {recorder_hz} Hz recorder apart, as those of JIGSAWS do.

To play one:
    source: {{kind: jigsaws, path: {path}, task: {task}, trial: {first}}}
"""

_ONE: Final = """\
Trial k of seed n is the movement of the source {kind: synthetic, hands: [left, right]} for the seed
1000 n + k. It is calibrated to aggregate statistics of recorded suturing. "tis synth --check" prints the
calibration."""

_ARM: Final = """

The columns of the arms are those of an arm with dynamics of its own, as its sensors measure it. It executed the poses
of the synthetic arm, a set point for each row; row k shows it at the instant of set point k:
{plant}
"""

_SEVERAL: Final = """\
Each letter is a person. They differ as much as recorded people do, about a surgeon who is calibrated to aggregate
statistics of recorded suturing. Trial k of person p (from 1) of seed n is the movement of the person's source for the
seed 1000000 n + 1000 p + k, and these are the sources:
{people}"""


def readme(
    names: Sequence[str],
    source: SyntheticSource,
    seed: int,
    n_people: int | None,
    task: str,
    command: str,
    path: Path,
    arm: Scenario | None = None,
) -> str:
    """Return the text for the trials ``names`` in the folder ``path``, of ``n_people`` about ``source``.

    Without ``n_people`` they are of the source itself. The plant of the scenario ``arm`` executed them.
    """
    return _TEXT.format(
        first=names[0],
        last=names[-1],
        command=command,
        task=task,
        rate_hz=RATE_HZ,
        letter_1=SYNTHETIC_SUBJECTS[0],
        letter_n=SYNTHETIC_SUBJECTS[-1],
        whose=(_ONE if n_people is None else _SEVERAL.format(people=_people(source, seed, n_people)))
        + ("" if arm is None else _ARM.format(plant=yaml.safe_dump(arm.patient.plant.model_dump(), width=100)[:-1])),
        recorder_hz=source.recorder_hz,
        path=path,
    )


def _people(source: SyntheticSource, seed: int, n_people: int) -> str:
    lines = []
    for index in range(n_people):
        one = person(source, seed, index)
        fields = ", ".join(f"{name}: {getattr(one, name)!r}" for name in SPREAD)
        lines += [f"    {SYNTHETIC_SUBJECTS[index]}: {{kind: synthetic, hands: [left, right], {fields}}}"]
    return "\n".join(lines)
