"""Command `tis synth`: trials of synthetic surgeons in JIGSAWS' format and folders, README and calibration."""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, get_args

import yaml
from rich.console import Console

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK, DataError, Fault, InputError
from tis.common.scenario import Scenario
from tis.common.scenario.source import SYNTHETIC_SUBJECTS, JigsawsSource, SyntheticSource
from tis.common.sources.calibration import (
    RECORDED_SUTURING,
    RECORDED_TURNING,
    TOLERANCE,
    median_statistics,
    turning_statistics,
)
from tis.common.sources.jigsaws import MIN_ROWS, RATE_HZ, trial_text
from tis.common.sources.population import MAX_TRIALS, SPREAD, person, population
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Recording
from tis.deploy.present.table import Table
from tis.patient_side.plant.build import executed, executing_plant

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
    lines, rows = [], f"recorder_hz: {source.recorder_hz}"
    for index in range(n_people):
        one = person(source, seed, index)
        fields = ", ".join(f"{name}: {getattr(one, name)!r}" for name in SPREAD)
        lines += [f"    {SYNTHETIC_SUBJECTS[index]}: {{kind: synthetic, hands: [left, right], {rows}, {fields}}}"]
    return "\n".join(lines)


_MAX_DURATION_S: Final = 3600.0

_SOURCE: Final = SyntheticSource(kind="synthetic", hands=("left", "right"), recorder_hz=51.33)
_CHECK_TRIALS: Final = 12
_CHECK_S: Final = 90.0


def write_trials(
    out_dir: Path,
    n_trials: int,
    task: str,
    seed: int,
    duration_s: float,
    command: str,
    n_people: int | None = None,
    arm: Scenario | None = None,
) -> list[Path]:
    """Write trials and a README into a new or empty folder, all or none; return the trials' files.

    The trials are S001, S002, ... of the calibrated surgeon, or with ``n_people`` (1 to 8) S001, ..., T001, ... of
    each person of the seed's `population`. The plant of the scenario ``arm``, if given, executes the movements, and
    the trials' arms are its own. Raises `InputError` with all faults of the numbers and the task,
    `DataError` when the folder is not empty or cannot be written.
    """
    _check(n_people, n_trials, task, seed, duration_s)
    if arm is not None:
        executing_plant(arm.patient.plant, seed, "PSM1")  # its faults are reported before anything is written
    out_dir = out_dir.absolute()
    letters = SYNTHETIC_SUBJECTS[: n_people or 1]
    names = [f"{letter}{trial:03d}" for letter in letters for trial in range(1, n_trials + 1)]
    text = readme(names, _SOURCE, seed, n_people, task, command, out_dir, arm)
    # Trials and README are written to a partial folder and moved; a failure removes everything again.
    is_new = not out_dir.exists()
    partial: Path | None = None
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        if any(out_dir.iterdir()):
            raise DataError(Fault(str(out_dir), "", "folder must be new or empty"))
        # within the target folder, so that all trials appear by a single rename
        partial = Path(tempfile.mkdtemp(dir=out_dir, prefix=".partial-"))
        folder = partial / task / "kinematics" / "AllGestures"
        folder.mkdir(parents=True)
        for name, recording in zip(names, _recordings(n_people, n_trials, seed, duration_s), strict=True):
            done = recording if arm is None else executed(recording, arm, _arm_seed(seed, name))
            (folder / f"{task}_{name}.txt").write_text(trial_text(done), "utf-8")
        (partial / "README.txt").write_text(text, "utf-8")
        (partial / "README.txt").replace(out_dir / "README.txt")
        (partial / task).replace(out_dir / task)
    except OSError as error:
        raise DataError(Fault(str(out_dir), "", f"cannot be written: {error.strerror}")) from None
    finally:
        if partial is not None:
            shutil.rmtree(partial, ignore_errors=True)
            if not (out_dir / task).exists():
                (out_dir / "README.txt").unlink(missing_ok=True)
                if is_new:
                    out_dir.rmdir()
    return [out_dir / task / "kinematics" / "AllGestures" / f"{task}_{name}.txt" for name in names]


def print_calibration(seed: int, out: Console) -> int:
    """Print the statistics of both arms in 12 trials of 90 s beside the recorded ones; return the exit code."""
    trials = [_trial(seed, number, _CHECK_S) for number in range(1, _CHECK_TRIALS + 1)]
    arms = [hand.follower for trial in trials for hand in trial.hands]
    found = median_statistics([arm.position_m for arm in arms], RATE_HZ)
    found |= median_statistics([arm.orientation for arm in arms], RATE_HZ, turning_statistics)
    known = {**RECORDED_SUTURING, **RECORDED_TURNING}
    ratios = {name: found[name] / recorded for name, recorded in known.items()}
    rows = [
        (name, f"{recorded:.4g}", f"{found[name]:.3g}", f"{ratios[name]:.2f}") for name, recorded in known.items()
    ]
    columns = ("median over trials and arms", "recorded", "synthetic", "ratio")
    out.print(Table("The arms' tips", columns, rows).terminal())
    far = [name for name, ratio in ratios.items() if abs(ratio - 1.0) > TOLERANCE]
    outcome = "all within" if not far else f"{len(far)} of {len(ratios)} outside"
    out.print(
        f"{_CHECK_TRIALS} trials of {_CHECK_S:g} s, seed {seed}; recorded: 29 JIGSAWS suturing trials, of "
        f"turning 19; {outcome} {100 * TOLERANCE:g} %"
    )
    return EXIT_INVALID_RUN if far else EXIT_OK


def _recordings(n_people: int | None, n_trials: int, seed: int, duration_s: float) -> Iterator[Recording]:
    if n_people is not None:
        return population(_SOURCE, seed, n_people, n_trials, RATE_HZ, _n_rows(duration_s))
    return (_trial(seed, number, duration_s) for number in range(1, n_trials + 1))


def _trial(seed: int, number: int, duration_s: float) -> Recording:
    return synthesise(_SOURCE, (MAX_TRIALS + 1) * seed + number, RATE_HZ, _n_rows(duration_s), 0)


def _arm_seed(seed: int, name: str) -> int:
    """Return the seed of the sensor noise in a trial: each has one of its own."""
    people = len(SYNTHETIC_SUBJECTS)
    return (people * seed + SYNTHETIC_SUBJECTS.index(name[0])) * (MAX_TRIALS + 1) + int(name[1:])


def _n_rows(duration_s: float) -> int:
    return int(duration_s * RATE_HZ + 1e-9)


def _check(n_people: int | None, n_trials: int, task: str, seed: int, duration_s: float) -> None:
    tasks = get_args(JigsawsSource.model_fields["task"].annotation)
    shortest_s = MIN_ROWS / RATE_HZ
    most = len(SYNTHETIC_SUBJECTS)
    rules = (
        (n_people is None or 1 <= n_people <= most, "--people", f"must be from 1 to {most}", n_people),
        (1 <= n_trials <= MAX_TRIALS, "--trials", f"must be from 1 to {MAX_TRIALS}", n_trials),
        (task in tasks, "--task", f"must be one of {', '.join(tasks)}", task),
        (seed >= 0, "--seed", "must be at least 0", seed),
        (
            duration_s <= _MAX_DURATION_S and _n_rows(duration_s) >= MIN_ROWS,
            "--duration-s",
            f"must be from {shortest_s:.3f} ({MIN_ROWS} rows) to {_MAX_DURATION_S:g}",
            duration_s,
        ),
    )
    faults = [Fault("tis synth", field, rule, got) for holds, field, rule, got in rules if not holds]
    if faults:
        raise InputError(faults)
