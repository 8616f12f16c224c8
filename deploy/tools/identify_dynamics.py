"""Command `tis identify --dynamics`: masses, inertias and friction of the simulated arm, as a table and a file."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.scenario import Scenario
from tis.deploy.present.table import Cell, Table
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs
from tis.patient_side.dynamics.consistent_fit import check_solver
from tis.patient_side.dynamics.identify import (
    DETERMINED,
    DURATION_S,
    N_TRAINING,
    N_VALIDATION,
    Dynamics,
    identify_dynamics,
)
from tis.patient_side.dynamics.parameters import NAMES, OF_JOINT, PER_LINK, joints, links, pseudo_inertia
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import JOINTS
from tis.patient_side.plant.physics import check_simulator


def identify_dynamics_and_print(
    scenario: Scenario, out_file: Path | None, figure_file: Path | None, out: Console
) -> int:
    """Identify and print the arm's base parameters; write the file if requested. Raises `InputError`, `DataError`."""
    plant = scenario.patient.plant
    faults = []
    if plant.kind != "mujoco":
        rule = "must be mujoco with --dynamics, which moves a simulated arm: --set patient.plant.kind=mujoco"
        faults.append(Fault("patient.plant", "kind", rule, plant.kind))
    if out_file is not None and out_file.suffix != ".json":
        faults.append(Fault("tis identify", "--out", "must end in .json", str(out_file)))
    if figure_file is not None:
        faults.append(Fault("tis identify", "--figure", "must not be given with --dynamics", str(figure_file)))
    if faults:
        raise InputError(faults)
    check_simulator()
    check_solver()
    check_outputs(out_file)
    assert plant.kind == "mujoco"
    found = identify_dynamics(plant, scenario.seed)
    out.print(_parameters(found).terminal())
    out.print(_torques(found).terminal())
    for line in _in_words(found):
        out.print(line, soft_wrap=True)
    if out_file is not None:
        folder.write(out_file, (json.dumps(_as_data(scenario, found), indent=1, allow_nan=False) + "\n").encode())
        out.print(f"written to {out_file}", soft_wrap=True)
    return EXIT_OK


def errors_pct(found: Dynamics) -> Array:
    """Return the errors (B,) of the base parameters in % of the true ones."""
    return np.asarray(100.0 * (found.identified - found.true) / np.abs(found.true))


def _parameters(found: Dynamics) -> Table:
    std_pct = 100.0 * found.std / np.abs(found.identified)
    each = zip(found.base.names(), found.true, found.identified, errors_pct(found), std_pct, strict=True)
    texts = [
        (name, f"{true:.4g}", f"{value:.4g}", f"{error:+.2f}", f"{std:.2g}") for name, true, value, error, std in each
    ]
    styles = ["" if determined else "dim" for determined in found.determined]
    rows = [[Cell(text, style) for text in row] for row, style in zip(texts, styles, strict=True)]
    return Table("Base parameters, in SI units", ("parameter", "true", "identified", "error, %", "std, %"), rows)


def _torques(found: Dynamics) -> Table:
    each = zip(JOINTS, found.error_pct, found.plain_error_pct, found.undetermined_pct, strict=True)
    return Table(
        "Torques on the validation movements, rms error in % of the rms torque",
        ("joint", "consistent fit", "plain least squares", "share of what is not determined"),
        [(joint, *(f"{value:.3f}" for value in values)) for joint, *values in each],
    )


def _in_words(found: Dynamics) -> list[str]:
    determined = found.determined
    largest = np.abs(errors_pct(found)[determined]).max() if determined.any() else float("nan")
    smallest = min(np.linalg.eigvalsh(pseudo_inertia(link))[0] for link in links(found.values))
    return [
        f"{N_TRAINING} movements of {DURATION_S:g} s train, {N_VALIDATION} others validate: "
        f"{found.rows[0]} and {found.rows[1]} rows",
        f"{int(determined.sum())} of {len(determined)} base parameters are determined (standard deviation at most "
        f"{100 * DETERMINED:g} %); their largest error is {largest:.2f} %",
        f"bodies that can exist: the least eigenvalue of a pseudo-inertia is {smallest:.2g}, the least friction "
        f"{joints(found.values)[:, 1:].min():.2g}",
    ]


def _as_data(scenario: Scenario, found: Dynamics) -> dict[str, Any]:
    std = found.std.tolist()
    base = zip(found.base.terms(), found.true, found.identified, std, found.determined, strict=True)
    of_joint = PER_LINK - len(OF_JOINT)
    return {
        "format": "tis dynamics",
        "version": 1,
        "arm": scenario.patient.plant.model_dump(),
        "seed": scenario.seed,
        "gravity_m_s2": 9.81,
        "base_parameters": [
            {
                "sum": name,
                "true": float(true),
                "identified": float(value),
                "std": deviation,
                "determined": bool(known),
            }
            for name, true, value, deviation, known in base
        ],
        "torque_error_pct": dict(zip(JOINTS, found.error_pct.tolist(), strict=True)),
        "links": [
            dict(zip([name.rsplit("_", 1)[0] for name in NAMES[:of_joint]], link.tolist(), strict=True))
            for link in links(found.values)
        ],
        "joints": [dict(zip(OF_JOINT, joint.tolist(), strict=True)) for joint in joints(found.values)],
    }
