"""Recorded trials as tables: what a run plays is what it plays of the JIGSAWS file, its rows as recorded."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from tis.common.runtime.recordings import load_recording
from tis.common.scenario.reading import build_scenario
from tis.deploy.recordings_import.command import import_recording
from tis.deploy.recordings_import.found import Wanted


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_recorded_trial_is_played_from_a_table_as_from_its_file(
    jigsaws_dir: Path, tmp_path: Path, suffix: str
) -> None:
    file = jigsaws_dir / "Suturing" / "kinematics" / "AllGestures" / "Suturing_D002.txt"
    quiet, table = Console(quiet=True), tmp_path / f"t.{suffix}"
    assert import_recording(file, table, Wanted(), None, {}, quiet, quiet) == 0

    def played(**source: Any) -> Any:
        raw = {"version": 1, "name": "s", "duration_s": 20, "source": {**source, "hands": ["left", "right"]}}
        return load_recording(build_scenario(raw, "s.yaml"))

    own = played(kind="jigsaws", path=str(jigsaws_dir), trial="D002", clock="as_recorded")
    found = played(kind="table", path=str(table))
    assert len(found) == len(own)
    assert found.start == own.start
    for mine, theirs in zip(own.hands, found.hands, strict=True):
        assert (mine.hand, mine.arm) == (theirs.hand, theirs.arm)  # found in the data, and CRTK's convention
        for a, b in ((mine.command, theirs.command), (mine.follower, theirs.follower)):
            assert np.array_equal(a.position_m, b.position_m)
            assert np.array_equal(a.gripper_rad, b.gripper_rad)
            assert np.abs(a.orientation - b.orientation).max() < 1e-15
