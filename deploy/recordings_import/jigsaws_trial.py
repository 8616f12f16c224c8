"""Poses from a trial of JIGSAWS: all four devices, at the 30 rows a second of the data set."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import DataError, Fault
from common.runtime.limited_file import read_limited
from common.scenario.source import is_synthetic
from common.sources.jigsaws import MAX_TRIAL_BYTES, RATE_HZ, parse_trial, pose_track
from common.units import NS_PER_S
from deploy.recordings_import.found import DEVICES, Found, Stream


def read_jigsaws(file: Path) -> Found:
    """Return the poses of a trial's file, like Suturing_D002.txt; raises `DataError`.

    Task and person are read off its name. Oracle: trials of `tis synth`, played from either file.
    """
    where = str(file)
    try:
        text = read_limited(file, MAX_TRIAL_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise DataError(Fault(where, "", f"cannot be read: {error.strerror}")) from None
    except UnicodeDecodeError as error:
        raise DataError(Fault(where, "", f"is not UTF-8 text (at byte {error.start})")) from None
    rows = parse_trial(text, where)
    t_ns = np.arange(len(rows), dtype=np.int64) * NS_PER_S // RATE_HZ
    streams = []
    for device in DEVICES:
        track = pose_track(rows, device, where)
        streams.append(
            Stream(device, f"columns of {device}", t_ns, track.position_m, track.orientation, track.gripper_rad)
        )
    about: dict[str, Any] = {"kind": "jigsaws"}
    named = re.fullmatch(r"([A-Za-z_]+)_([A-Z]\d{3})\.txt", file.name)
    if named:
        about |= {"task": named[1], "person": named[2][0]}
        about |= {"synthetic": True} if is_synthetic(named[2]) else {}
    return Found(tuple(streams), (), (f"{len(rows)} rows of four devices, {RATE_HZ} a second",), about)
