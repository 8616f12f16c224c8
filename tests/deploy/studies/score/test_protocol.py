"""The frozen protocol: its movements are the same on every processor, and its twins are what they were."""

import hashlib
import importlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tis.common.scenario.reading import build_scenario
from tis.common.units import NS_PER_S
from tis.deploy.compare.cells.identity import dump, value_digest
from tis.deploy.studies.score import population
from tis.deploy.studies.score.protocol import NAME, content, digest, hashes, settings

_SHORT_S = 3.0
_SHORT = """
import hashlib
from tis.deploy.studies.score.population import table
for data in ("direct", "lagging"):
    print(hashlib.sha256(table(data, 1, 7, 3.0).encode()).hexdigest())
"""


def test_the_population_has_a_hash_for_each_table_and_nobody_is_trained_on_and_scored() -> None:
    trained, scored = population.trained(), population.scored()
    assert not set(trained.files) & set(scored.files)
    names = {f"{data}/{name}" for data in ("direct", "lagging") for name in (*trained.files, *scored.files)}
    assert set(hashes()) == names


def test_a_table_is_the_protocols() -> None:
    made = population.table("direct", 1, 6, population.scored().duration_s).encode()
    assert hashlib.sha256(made).hexdigest() == hashes()["direct/P07_1.csv"]


def test_another_processor_makes_the_same_table() -> None:
    """numpy's vector units and those of its linear algebra are switched off."""
    numpy = importlib.import_module("numpy._core._multiarray_umath")
    off = " ".join(name for name in numpy.__cpu_dispatch__ if numpy.__cpu_features__.get(name))
    environment = {**os.environ, "NPY_DISABLE_CPU_FEATURES": off, "OPENBLAS_CORETYPE": "Nehalem"}
    found = subprocess.run(
        [sys.executable, "-c", _SHORT], env=environment, capture_output=True, text=True, check=True
    )
    here = [
        hashlib.sha256(population.table(data, 1, 7, _SHORT_S).encode()).hexdigest() for data in ("direct", "lagging")
    ]
    assert found.stdout.split() == here


def test_no_value_is_near_the_border_where_a_last_bit_would_decide() -> None:
    """All of the protocol's tables have 2.7e-6 of a unit; here one of them."""
    assert population.least_margin("direct", 1, 6, population.scored().duration_s) > 2e-6


def test_rows_are_uneven_and_state_their_instants_in_whole_ns() -> None:
    lines = population.table("direct", 1, 7, _SHORT_S).splitlines()
    heads, rows = lines[0].split(","), [line.split(",") for line in lines[1:]]
    assert heads[:2] == ["time_s", "MTML_x_m"]
    assert len(rows) == 90
    at_ns = np.array([int(row[0].replace(".", "")) for row in rows])
    beside_ms = (at_ns - np.arange(90) * NS_PER_S / 30) / 1e6
    assert np.abs(beside_ms).max() < 5.1
    assert len(set(np.round(beside_ms).tolist())) > 5
    assert all(len(row[1].partition(".")[2]) == 9 for row in rows)


@pytest.mark.parametrize(
    ("value", "text"), [(0, "0.000000000"), (-1, "-0.000000001"), (1_234_567_890, "1.234567890")]
)
def test_whole_units_are_written_exactly(value: int, text: str) -> None:
    assert population._decimal(value, 9) == text


def test_a_changed_table_is_written_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place, group = tmp_path, population.Group(range(6, 7), population.scored().duration_s)
    (file,) = population.write(place, "direct", group, 1)
    whole = file.read_bytes()
    file.write_bytes(whole[:-20])
    assert population.write(place, "direct", group, 1) == [file]
    assert file.read_bytes() == whole


def test_a_twin_of_the_protocol_is_what_it_was() -> None:
    """A default of a scenario's field that changes would change the protocol's twins: then the protocol names it."""
    source = {"kind": "table", "path": "P07_1.csv", "hands": ["left"], "resample": True}
    found = [dump(build_scenario(one.scenario(1, 39.0, source, ["hold"]), NAME)) for one in settings("open", False)]
    assert value_digest(found) == "1b31006ae318b316"  # a unit of positions that is not given is the metre, as before


def test_recordings_have_no_lagging_arm_and_quick_is_a_part() -> None:
    assert [one.name for one in settings("open", False)] == list(content()["settings"])
    assert {one.data for one in settings("jigsaws", False)} == {"direct"}
    assert {one.name for one in settings("open", True)} < set(content()["settings"])
    assert len(digest()) == 64
