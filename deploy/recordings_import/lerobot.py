"""Poses from a LeRobot data set, versions 2 and 3: Parquet files below data/, described by meta/info.json.

Most sets hold angles of joints, which are refused: which positions they are depends on the arm's kinematics.
"""

import json
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from tis.common.errors import DataError, Fault, InputError
from tis.common.extras import GET_PARQUET
from tis.common.runtime.scenario_files import read_limited
from tis.common.scenario.table_source import PoseColumns, PoseUnits
from tis.common.sources.table_columns import MAX_ROWS, MAX_VALUES, DeviceLayout, in_few
from tis.common.sources.table_poses import finite_faults, pose_track, unit_doubts
from tis.common.sources.trajectory import one_hemisphere
from tis.common.units import NS_PER_S
from tis.deploy.recordings_import.element_names import (
    OF_FORCES,
    OF_JOINTS,
    Elements,
    column_of,
    elements_of,
    names_in,
    units_in,
)
from tis.deploy.recordings_import.found import MASTERS, Array, Extra, Found, Ints, Stream, Wanted

INFO: Final = Path("meta") / "info.json"
VECTORS: Final = ("observation.state", "action")

_UNIT_OPTIONS: Final = "--angle-unit, --gripper-unit and --position-unit name the units"
_MAX_INFO_BYTES: Final = 10_000_000
_MAX_WIDTH: Final = 1000
_MAX_FILES: Final = 100_000


def read_lerobot(folder: Path, wanted: Wanted) -> Found:
    """Return the poses of one episode: of the arms from observation.state, of the masters from action.

    Raises `DataError` for a damaged set and one without the episode, `InputError` where names of the elements are
    needed and without pyarrow. Oracle: sets of both versions that the tests write.
    """
    if find_spec("pyarrow") is None:
        raise InputError(Fault("tis import", "", f"a LeRobot data set needs pyarrow: {GET_PARQUET}"))
    info = _info(folder)
    where = str(folder)
    notes, devices = [], list[tuple[str, Elements]]()
    joints = list[str]()
    for vector in VECTORS:
        feature = info["features"].get(vector)
        if not isinstance(feature, Mapping):
            continue
        names = wanted.names.get(vector) or names_in(feature)
        found = elements_of(names, is_action=vector == "action")
        joints += [] if found else [f"{vector} {name}" for name in names if OF_JOINTS.search(name)]
        notes.append(f"{vector}: {' '.join(names) or 'elements without names'}")
        devices += [(vector, each) for each in found]
    planned = {each.device for vector, each in devices if vector == "action" and each.device not in MASTERS}
    if planned:
        devices = [(vector, each) for vector, each in devices if vector == "action" or each.device not in planned]
        arms = ", ".join(sorted(planned))
        notes.append(f"action: the set points of {arms}, which are taken; no master was recorded, so the arm's pose "
                     "is the command, too, and what observation.state measured is left out")  # fmt: skip
    if not devices and joints:
        rule = "holds angles of joints, which are no positions: record or convert it with poses of the end effector"
        how = "(in LeRobot the processor ForwardKinematicsJointsToEE, by the arm's URDF)"
        raise InputError(Fault(where, "", f"{rule} {how}; {in_few(joints)}"))
    if not devices:
        rule = "has no named positions in observation.state or action; --names VECTOR=left_x,left_y,... names them"
        raise InputError(Fault(where, "", f"{rule} ({'; '.join(notes) or 'it has neither'})"))
    table, others = _episode(folder, wanted.episode, sorted({vector for vector, _ in devices}), _others(info))
    t_ns, clock = _instants(table, info)
    faults = _wrong_names(table, wanted)
    if faults:
        raise DataError(faults)
    streams, doubts = [], list[str]()
    for vector, elements in devices:
        stream, more = _stream(vector, table[vector], t_ns, elements, wanted, where, doubts)
        faults += more
        notes += [] if stream is None else [f"{vector} -> poses of {elements.device}, {_units(elements, wanted)}"]
        streams += [] if stream is None else [stream]
    if faults:
        raise DataError(faults)
    extras, more_notes = _extras(others, info["features"], t_ns)
    notes += more_notes
    single = any(table[vector].dtype == np.float32 for vector in table if vector in VECTORS)
    notes += [clock, *(["numbers have single precision, 7 digits"] if single else [])]
    about = {"kind": "lerobot", "episode": wanted.episode, "version": str(info.get("codebase_version", ""))[:20]}
    return Found(tuple(streams), (), tuple(notes), about, extras=extras, doubts=tuple(doubts))


def _units(elements: Elements, wanted: Wanted) -> str:
    """Return the units of what a device has: a quaternion has none."""
    has_angles = elements.euler is not None or elements.rotation_vector is not None
    angles = [f"angles in {wanted.angle_unit}"] if has_angles else []
    gripper = [] if elements.gripper is None else [f"gripper in {wanted.gripper_unit}"]
    return ", ".join([f"position in {wanted.position_unit}", *angles, *gripper])


def _others(info: Mapping[str, Any]) -> list[str]:
    """Return the features of an observation with one row of numbers, beside the state."""
    return [
        str(name)
        for name, feature in info["features"].items()
        if str(name).startswith("observation.") and name not in VECTORS and isinstance(feature, Mapping)
        and feature.get("dtype") in ("float32", "float64")
        and isinstance(feature.get("shape"), list) and len(feature["shape"]) == 1
    ]  # fmt: skip


def _extras(
    others: Mapping[str, Any], features: Mapping[str, Any], t_ns: Ints
) -> tuple[tuple[Extra, ...], list[str]]:
    """Return the vectors with a stated unit, and those of forces, as columns; the others are named as left out."""
    found, notes = list[Extra](), []
    for vector, given in others.items():
        values = np.zeros((len(t_ns), 1)) if given is None else given.reshape(len(t_ns), -1)
        width = values.shape[1]
        names, units = names_in(features[vector]), units_in(features[vector], width)
        why = "it is not in the file, or no vector of numbers" if given is None else ""
        why = why or ("not all of its numbers are finite" if not np.isfinite(values).all() else "")
        why = why or ("its unit is not stated" if units is None and not OF_FORCES.search(vector) else "")
        if why:
            notes.append(f"{vector}: left out, as {why}")
            continue
        elements = names if len(names) == width else tuple(str(k) for k in range(width))
        columns = [column_of(vector, *each) for each in zip(elements, units or ("",) * width, strict=True)]
        if len({*columns, *(extra.column for extra in found)}) < len(columns) + len(found):
            notes.append(f"{vector}: left out, as its columns would have names that are taken")
            continue
        said = ", ".join(dict.fromkeys(units)) if units else "a unit that is not stated"
        notes.append(f"{vector} -> columns {in_few(columns, 3)}, in {said}, which no run plays")
        found += [
            Extra(column, unit, t_ns, values[:, k])
            for k, (column, unit) in enumerate(zip(columns, units or ("",) * width, strict=True))
        ]
    return tuple(found), notes


def _wrong_names(table: Mapping[str, Any], wanted: Wanted) -> list[Fault]:
    """Return the faults of ``--names`` that are not as many as the vector's elements: which they are is not known."""
    found = []
    for vector, names in wanted.names.items():
        if vector not in table:
            rule = f"must begin with {' or '.join(VECTORS)}, and name positions"
            found.append(Fault("tis import", "--names", rule, vector))
        elif len(names) != (n := table[vector].shape[1]):
            rule = f"must name all {n} elements of {vector}, those that are no part of a pose by any word like -"
            found.append(Fault("tis import", "--names", rule, len(names)))
    return found


def _info(folder: Path) -> dict[str, Any]:
    file = folder / INFO
    try:
        info = json.loads(read_limited(file, _MAX_INFO_BYTES))
    except OSError as error:
        raise DataError(Fault(str(file), "", f"cannot be read: {error.strerror}")) from None
    except (ValueError, RecursionError):
        raise DataError(Fault(str(file), "", "is no JSON")) from None
    if not isinstance(info, dict) or not isinstance(info.get("features"), dict):
        raise DataError(Fault(str(file), "features", "must describe the data set's columns"))
    return info


def _episode(
    folder: Path, episode: int, vectors: list[str], others: list[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the columns of an episode, in order of its frames, and those of ``others``, None for what is none.

    Version 2 has a file per episode, version 3 several episodes in a file: both name it in a column.
    """
    files = sorted((folder / "data").rglob("*.parquet"))[:_MAX_FILES]
    own = [file for file in files if file.stem == f"episode_{episode:06d}"]
    seen: set[int] = set()
    for file in own or files:
        columns = _columns(file, ["episode_index"])
        index = columns["episode_index"]
        seen |= set(np.unique(index).tolist()[:1000])
        rows = np.flatnonzero(index == episode)
        if not len(rows):
            continue
        table = _columns(file, ["frame_index", "timestamp", *vectors])
        order = rows[np.argsort(table["frame_index"][rows], kind="stable")]
        return {name: values[order] for name, values in table.items()}, {
            name: None if (values := _numbers(file, name)) is None else values[order] for name in others
        }
    there = f"it has episodes {min(seen)} to {max(seen)}" if seen else "it has none"
    raise DataError(Fault(str(folder), "--episode", f"is not in the data set: {there}", episode))


def _numbers(file: Path, name: str) -> Array | None:
    """Return a column of numbers that no pose needs, None where it is none."""
    try:
        return np.asarray(_columns(file, [name])[name], dtype=np.float64)
    except (DataError, ValueError, TypeError):
        return None


def _columns(file: Path, names: list[str]) -> dict[str, Any]:
    """Return columns as arrays (N,) or (N, width); raises `DataError`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        parquet = pq.ParquetFile(file)
        missing = [name for name in names if name not in parquet.schema_arrow.names]
        if missing:
            raise DataError(Fault(str(file), "", f"has no column {', '.join(missing)}"))
        if parquet.metadata.num_rows > MAX_ROWS:
            raise DataError(Fault(str(file), "", f"must have at most {MAX_ROWS} rows", parquet.metadata.num_rows))
        # a compressed column may hold far more than the file's size
        groups = [parquet.metadata.row_group(k) for k in range(parquet.metadata.num_row_groups)]
        chunks = [group.column(k) for group in groups for k in range(group.num_columns)]
        n_values = sum(chunk.num_values for chunk in chunks if chunk.path_in_schema.startswith(tuple(names)))
        if n_values > MAX_VALUES:
            raise DataError(Fault(str(file), "", f"must hold at most {MAX_VALUES} numbers to read", n_values))
        table = parquet.read(columns=names)
        return {name: _array(table.column(name).combine_chunks(), file, name) for name in names}
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        text = " ".join(str(error).split())[:200]
        raise DataError(Fault(str(file), "", f"is no Parquet file, or damaged: {text}")) from None


def _array(column: Any, file: Path, name: str) -> Any:
    import pyarrow as pa

    kind = column.type
    if not (pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)):
        return column.to_numpy(zero_copy_only=False)
    values = column.flatten().to_numpy(zero_copy_only=False)
    n_rows = len(column)
    width = len(values) // n_rows if n_rows else 0
    lengths = np.asarray(column.value_lengths().fill_null(-1))
    if not 0 < width <= _MAX_WIDTH or bool((lengths != width).any()):
        raise DataError(Fault(str(file), f"column {name}", f"must hold vectors of one length up to {_MAX_WIDTH}"))
    return values.reshape(n_rows, width)


def _instants(table: Mapping[str, Any], info: Mapping[str, Any]) -> tuple[Ints, str]:
    """Return the instants of the frames in ns: by number and fps, exactly, where the timestamps agree."""
    fps, frames = info.get("fps"), table["frame_index"].astype(np.int64)
    stamps_s = table["timestamp"].astype(np.float64)
    if isinstance(fps, int | float) and not isinstance(fps, bool) and 0 < fps <= 1e6:
        by_number_s = frames / fps
        off_s = float(np.abs(stamps_s - stamps_s[0] - (by_number_s - by_number_s[0])).max())
        if off_s < 0.1 / fps:
            return np.round(by_number_s * NS_PER_S).astype(np.int64), f"{fps:g} frames a second, evenly"
    return np.round(stamps_s * NS_PER_S).astype(np.int64), "instants of the column timestamp"


def _stream(
    vector: str, values: Array, t_ns: Ints, elements: Elements, wanted: Wanted, where: str, doubts: list[str]
) -> tuple[Stream | None, list[Fault]]:
    """Return the poses that elements of a vector hold, and the faults; ``doubts`` of their units are added."""
    places = [*elements.position, *(elements.quaternion or elements.euler or elements.rotation_vector or ())]
    places += [] if elements.gripper is None else [elements.gripper]
    if max(places) >= values.shape[1]:
        rule = f"must have the {max(places) + 1} elements that are named"
        return None, [Fault(where, vector, rule, int(values.shape[1]))]
    columns = {f"{vector}[{k}]": values[:, k].astype(np.float64) for k in places}
    faults = finite_faults(columns, where)
    if faults:
        return None, faults

    def named(which: tuple[int, ...] | None) -> tuple[str, ...] | None:
        return None if which is None else tuple(f"{vector}[{k}]" for k in which)

    pose = PoseColumns.model_validate(
        {
            "position": named(elements.position),
            "quaternion": named(elements.quaternion),
            "euler": named(elements.euler),
            "gripper": None if elements.gripper is None else f"{vector}[{elements.gripper}]",
        }
    )
    units = PoseUnits(position=wanted.position_unit, angle=wanted.angle_unit, gripper=wanted.gripper_unit)
    layout = DeviceLayout(elements.device, pose, units)
    track, faults = pose_track(columns, layout, where)
    doubts += [f"{text} {_UNIT_OPTIONS}" for text in unit_doubts(columns, layout)]
    orientation = track.orientation if elements.quaternion or elements.euler else None
    if elements.rotation_vector is not None:
        turned = Rotation.from_rotvec(values[:, elements.rotation_vector].astype(np.float64))
        orientation = one_hemisphere(turned.as_quat())
    stream = Stream(
        elements.device,
        vector,
        t_ns,
        track.position_m,
        orientation,
        None if elements.gripper is None else track.gripper_rad,
    )
    return stream, faults
