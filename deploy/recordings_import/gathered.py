"""Streams from gathered messages: in order of time, each instant once, and what was left out in words."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.scenario.table_source import PoseColumns, PoseUnits
from tis.common.sources.table_columns import DeviceLayout
from tis.common.sources.table_poses import finite_faults, pose_track
from tis.deploy.recordings_import.found import Array, Ints, Jaw, Rows, Stream

_NAMES: Final = ("x", "y", "z", "qx", "qy", "qz", "qw")
_PLACE: Final = DeviceLayout("", PoseColumns(position=("x", "y", "z")), PoseUnits())
_WHOLE: Final = DeviceLayout(
    "", PoseColumns(position=("x", "y", "z"), quaternion=("qx", "qy", "qz", "qw")), PoseUnits()
)


def streams_of(
    poses: Mapping[str, str], jaws: Mapping[str, str], rows: Mapping[str, Rows], where: str, skips_unreadable: bool
) -> tuple[tuple[Stream, ...], tuple[Jaw, ...], list[str]]:
    """Return the streams and grippers of the chosen topics, and notes.

    Raises `DataError` for messages that cannot be read, unless they are skipped, for fewer than two poses, numbers
    that are not finite and quaternions whose norm is not 1. Messages are sorted by instant; of those with one instant
    the first counts. Oracle: shuffled and repeated messages, test_mcap_file.
    """
    faults = (
        []
        if skips_unreadable
        else [
            Fault(
                where,
                topic,
                "holds messages that cannot be read; --skip-unreadable leaves them out",
                of.n_undecodable,
            )
            for topic, of in rows.items()
            if of.n_undecodable
        ]
    )
    notes, streams, angles = list[str](), [], []
    for device, topic in poses.items():
        t_ns, values, found = _in_order(rows[topic], topic)
        notes += found
        if len(t_ns) < 2:
            faults.append(Fault(where, topic, "must have at least 2 poses that can be read", len(t_ns)))
            continue
        turned = ~np.isnan(values[:, 3:7]).any(axis=1)
        if turned.any() and not turned.all():
            notes.append(f"{topic}: {int((~turned).sum())} messages lack an orientation, so it is left out")
        columns = {name: values[:, k] for k, name in enumerate(_NAMES)}
        layout = _WHOLE if turned.all() else _PLACE
        bad = finite_faults({name: columns[name] for name in layout.names}, f"{where}: {topic}")
        if not bad:
            track, bad = pose_track(columns, layout, f"{where}: {topic}")
        if bad:
            faults += bad
            continue
        gripped = bool(np.isfinite(values[:, 7]).all())
        turns = track.orientation if turned.all() else None
        streams.append(Stream(device, topic, t_ns, track.position_m, turns, values[:, 7] if gripped else None))
    for device, topic in jaws.items():
        t_ns, values, found = _in_order(rows[topic], topic)
        notes += found
        if len(t_ns) < 2:
            notes.append(f"{topic}: fewer than 2 angles that can be read, so {device} gets none from it")
        else:
            bad = finite_faults({"position[0]": values[:, 0]}, f"{where}: {topic}")
            faults += bad
            angles += [] if bad else [Jaw(device, topic, t_ns, values[:, 0])]
    if faults:
        raise DataError(faults)
    return tuple(streams), tuple(angles), notes


def _in_order(rows: Rows, topic: str) -> tuple[Ints, Array, list[str]]:
    t_ns, values = rows.arrays()
    notes = []
    if rows.n_undecodable:
        notes.append(f"{topic}: {rows.n_undecodable} messages cannot be read and are left out")
    if rows.n_unstamped:
        notes.append(f"{topic}: {rows.n_unstamped} messages hold no instant; that of the recorder counts")
    n_back = int(np.count_nonzero(np.diff(t_ns) < 0))
    unique, first = np.unique(t_ns, return_index=True)
    if n_back:
        notes.append(f"{topic}: {n_back} messages are earlier than the one before; they are sorted")
    if len(unique) < len(t_ns):
        notes.append(f"{topic}: {len(t_ns) - len(unique)} messages repeat an instant and are left out")
    return unique, values[first], notes
