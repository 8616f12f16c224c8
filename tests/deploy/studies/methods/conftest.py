"""Recordings of three people in two tasks, in the format of JIGSAWS, made up; and twins that take little time."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from tis.deploy.compare.plan import Plan, Request, make_plan
from tis.deploy.studies.methods import plans
from tis.deploy.studies.methods.trials import Trials, find_trials
from tis.deploy.tools.synth import write_trials

_HELD = {"patient.orientation": "{methods: [hold], active: hold}"}


@pytest.fixture(scope="session")
def people(tmp_path_factory: pytest.TempPathFactory) -> Trials:
    """Return two trials of 10 s of each of three people, and two of them at another task."""
    folder = tmp_path_factory.mktemp("methods") / "recordings"
    other = folder.with_name("other")
    write_trials(folder, 2, "Suturing", 1, 10.0, "a test", 3)
    write_trials(other, 1, "Knot_Tying", 2, 8.0, "a test", 2)
    (other / "Knot_Tying").rename(folder / "Knot_Tying")
    return find_trials(str(folder), "Suturing", Path(), 1, 10.0)


def _add_to_plans(settings: Mapping[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let each plan have these settings where it does not give them itself."""

    def cheaply(request: Request) -> Plan:
        given = {setting.partition("=")[0] for setting in request.settings}
        added = [f"{path}={value}" for path, value in settings.items() if path not in given]
        return make_plan(replace(request, settings=(*request.settings, *added)))

    monkeypatch.setattr(plans, "make_plan", cheaply)


@pytest.fixture
def held_orientation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hold the orientation, of which no table tells: the methods for it take as long as all else."""
    _add_to_plans(_HELD, monkeypatch)


@pytest.fixture
def quick_twins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let twins and trainings take little time: small models, a short twin at 1 kHz, and an orientation that is held.

    What a plan itself says of its models counts.
    """
    _add_to_plans({**_HELD, "identification.block_rows": "3", "identification.order": "2"}, monkeypatch)
    monkeypatch.setattr(plans, "_FAST_S", 2.5)
    monkeypatch.setattr(plans, "_FAST_ROWS", 2000)
