"""Commands that play an imported table, with the settings that its rows need; only those that run are named."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from tis.common.channels import FOLLOWER, MASTER, Hand
from tis.common.errors import DataError, InputError
from tis.common.runtime.process import command_line
from tis.common.runtime.recordings import build_whole, load_recording
from tis.common.runtime.recordings.table_file import open_table
from tis.common.runtime.run_folders import RUNS
from tis.common.runtime.scenario_files import read_scenario
from tis.common.scenario.identification import MIN_TRAIN_SAMPLES, Identification
from tis.common.scenario.patient import PatientPart
from tis.common.scenario.reading import apply_settings, setting
from tis.common.sources.table_columns import TIME, canonical_names, in_few
from tis.common.sources.table_poses import played, row_clock
from tis.common.yaml_text import load_yaml
from tis.deploy.recordings_import.found import DEVICES, Array
from tis.deploy.shell.shipped_scenarios import SHIPPED
from tis.patient_side.models import models_for

_SCENARIO: Final = SHIPPED / "default.yaml"
_NOISE: Final = "identification.sensor_noise_mm=0.01"
"""Without it no model learns from an axis that rests, as z of a rover, or from an ideal sine."""
_DELAYS: Final = "network.forward.delay.delay_ms=30,100,200"
"""One delay would not show how far ahead an estimator carries; those of the manual."""
_MAX_HZ: Final = 10_000
_MAX_NAME_CHARS: Final = 40
_SCORED_S: Final = 3  # ticks are scored from 2 s after the first arrival on
_HANDS: Final[tuple[Hand, ...]] = ("left", "right")


def next_commands(file: Path, columns: Mapping[str, Array]) -> list[str]:
    """Return lines with a command that plays the table and one that compares estimators on it, or why none can.

    The settings are tried, up to the identification of the arm's model, before they are printed. Oracle: the printed
    commands run, test_next_commands.
    """
    rate_hz, n_rows, settings = _settings(file, columns)
    needed = MIN_TRAIN_SAMPLES + _SCORED_S * rate_hz
    if n_rows < needed:
        there = f"{file} has {len(columns[TIME])} rows"
        there += "" if n_rows == len(columns[TIME]) else f", {n_rows} after resampling to {rate_hz} a second"
        rule = f"a run needs {needed} at {rate_hz} a second, {needed / rate_hz:.1f} s"
        parts = f"{MIN_TRAIN_SAMPLES} to learn from, and {_SCORED_S} s to be scored"
        return [f"it cannot be played, as the recording is too short: {there}; {rule}: {parts}"]
    for tried in (settings, [*settings, _NOISE]):
        whole = [*tried, "duration_s=auto"]
        try:
            scenario = build_whole(apply_settings(read_scenario(_SCENARIO), whole), str(_SCENARIO))
            models_for(scenario, load_recording(scenario))
        except (DataError, InputError) as error:
            faults = error.faults
            continue
        own = [*tried, "identification.train=own_head"]  # the folder's other tables may have other columns
        name = f"name={_run_name(file)}"
        more = ("--sweep", _DELAYS, "--out", str(RUNS / "compare" / file.stem))
        return [
            f"play it with: {_command('twin', [name, *whole])}",
            f"compare estimators on it with: {_command('compare', [name, *own], *more)}",
        ]
    return [f"it cannot be played yet: {fault}" for fault in faults]


def own_table(file: Path) -> list[str]:
    """Return lines on why a table needs no import, and how it is played; raises `DataError` for what is none."""
    table = open_table(file)
    axes = {device: canonical_names(device)[:3] for device in DEVICES}
    names = [TIME, *(name for three in axes.values() if set(three) <= set(table.names) for name in three)]
    if TIME not in table.names or len(names) == 1:
        rule = "is a table, which needs no import: source.columns names what to read"
        return [f"{rule}, as examples/own_recording.yaml does; its columns: {in_few(table.names)}"]
    return ["has the columns of tis, so that it needs no import", *next_commands(file, table.read(names, TIME))]


def _command(name: str, settings: list[str], *more: str) -> str:
    return command_line([name, _SCENARIO.stem, *(word for each in settings for word in ("--set", each)), *more])


def _run_name(file: Path) -> str:
    """Return the file's name as a scenario may have it, and as YAML takes it for a text."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", file.stem).strip("_-")[:_MAX_NAME_CHARS]
    return name if isinstance(load_yaml(name, "name"), str) else f"recording_{name}".strip("_")


def _settings(file: Path, columns: Mapping[str, Array]) -> tuple[int, int, list[str]]:
    """Return the rows a second, their number, and settings for them.

    Gaps and uneven rows are interpolated, at the nearest rate of whole Hz. At most half of the rows train.
    """
    t_s = columns[TIME] - columns[TIME][0]
    clock, faults = row_clock(t_s, str(file), TIME)
    if clock is None:
        raise DataError(faults)
    rate_hz = min(max(round(clock.found_hz), 1), _MAX_HZ)
    play, faults = played(clock, rate_hz, False, "bridge", "")
    is_resampled = bool(faults or play.warnings)
    n_rows = int(t_s[-1] * rate_hz) + 1 if is_resampled else len(t_s)
    usual = Identification().train_samples
    n_training = max(MIN_TRAIN_SAMPLES, min(usual, n_rows // 2, n_rows - _SCORED_S * rate_hz))
    axes = [name for device in DEVICES for name in canonical_names(device)[:3] if name in columns]
    hands = [
        h for h in _HANDS if not {canonical_names(MASTER[h])[0], canonical_names(FOLLOWER[h])[0]}.isdisjoint(axes)
    ]
    source: dict[str, object] = {"kind": "table", "path": str(file), "hands": hands}
    source |= {"resample": True} if is_resampled else {}
    source |= {"gaps": "bridge"} if clock.gaps else {}
    rate = [] if rate_hz == 30 else [f"rate_hz={rate_hz}"]
    training = [] if n_training == usual else [f"identification.train_samples={n_training}"]
    phase = [f"patient.tick_phase_ms={500 / rate_hz:g}"] if PatientPart().tick_phase_ms * rate_hz >= 1000 else []
    return rate_hz, n_rows, [setting("source", source), *rate, *phase, *training]
