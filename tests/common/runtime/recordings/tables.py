"""Tables that the tests write."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario

Columns = dict[str, Any]


def movement(n_rows: int, rate_hz: float = 30.0, seed: int = 1, tremor_m: float = 0.0) -> Columns:
    """Return the canonical columns of a smooth master, which may tremble, and of an arm at half its movement."""
    t_s = np.arange(n_rows) / rate_hz
    columns: Columns = {"time_s": t_s}
    path = np.stack([0.02 * np.sin((axis + 1.3) * t_s + seed) for axis in range(3)], axis=1)
    path += tremor_m * np.random.default_rng(seed).standard_normal((n_rows, 3))
    half = 0.2 * np.sin(t_s + seed)
    for device, position in (("MTML", path), ("PSM2", 0.5 * path + 0.1)):
        columns |= {f"{device}_{axis}_m": position[:, k] for k, axis in enumerate("xyz")}
        columns |= {f"{device}_q{axis}": 0.0 * half for axis in "xy"}
        columns |= {f"{device}_qz": np.sin(half), f"{device}_qw": np.cos(half)}
        columns[f"{device}_gripper_rad"] = 0.5 + 0.5 * np.cos(t_s)
    return columns


def write_csv(file: Path, columns: Columns) -> Path:
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(repr(float(value)) for value in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n", "utf-8")
    return file


def write_parquet(file: Path, columns: Columns, metadata: bytes | None = None) -> Path:
    table = pa.table(columns)
    pq.write_table(table if metadata is None else table.replace_schema_metadata({b"tis": metadata}), file)
    return file


def scenario_of(path: Path | str, duration_s: float = 2, train: str = "own_head", **source: Any) -> Scenario:
    raw = {
        "version": 1,
        "name": "s",
        "duration_s": duration_s,
        "source": {"kind": "table", "path": str(path), **source},
        "identification": {"train": train, "train_samples": 100},
    }
    return build_scenario(raw, "s.yaml")
