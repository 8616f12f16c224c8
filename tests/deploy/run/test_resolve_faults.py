"""Whose fault it is: the file's, or that of an option over it."""

from pathlib import Path

import pytest

from tis.common.errors import InputError
from tis.deploy.run.resolve import resolve

GOOD = """version: 1
name: s
source: {kind: synthetic}
estimators: [hold, innovations_kf]
network: {forward: {delay: {kind: constant, delay_ms: 5}}}
"""


def _faults(
    folder: Path, *settings: str, more: str = "", swept: tuple[str, ...] = (), **values: float | None
) -> list[str]:
    file = folder / "s.yaml"
    file.write_text(GOOD + more)
    with pytest.raises(InputError) as caught:
        resolve(str(file), settings, swept=swept, **values)  # type: ignore[arg-type]
    return [str(fault).replace(str(file), "s.yaml") for fault in caught.value.faults]


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (["a.b=1"], ["--set: a.b: a: unknown key (got {'b': 1})"]),
        (["surgeon.copies=0"], ["--set: surgeon.copies: must be at least 1 (got 0)"]),
        (["surgeon={copies: 0}"], ["--set: surgeon.copies: must be at least 1 (got 0)"]),
        # what a value asks for elsewhere
        (["network.forward.delay={kind: uniform, low_ms: 5}"], ["--set: network.forward.delay.high_ms: is required"]),
        (
            ["seed=3", "network.forward.delay.low_ms=5", "network.forward.delay.high_ms=3"],
            [
                "--set: network.forward.delay.low_ms, network.forward.delay.high_ms: network.forward.delay: "
                "high_ms must be at least low_ms = 5.0"
            ],
        ),
        # a rule of the whole scenario
        (
            ["seed=3", "estimators=[hold]"],
            ["--set: estimators: active_estimator innovations_kf must be one of estimators (hold)"],
        ),
        (["seed=3", "seed=4"], ["--set: seed: is set more than once"]),
        (["seed=x", "seed=y"], ["--set: seed: is set more than once", "--set: seed: must be an integer (got 'y')"]),
        (
            ["network.profile=geo_satelite", "network.forward.delay.delay_ms=3"],
            [
                "--set: network.profile: must be a profile of the library or a file (.yaml); did you mean "
                "'geo_satellite'? (got 'geo_satelite')"
            ],
        ),
        # one that cannot be applied does not hide the others
        (
            ["seed", "estimators.7=hold", "network.profile=[", "a.b=1"],
            [
                "--set: network.profile: not YAML: did not find expected node content (got '[')",
                "--set: seed: must read a.b=VALUE",
                "--set: estimators.7: '7' is not an index of a list of 2",
                "--set: a.b: a: unknown key (got {'b': 1})",
            ],
        ),
    ],
)
def test_a_fault_is_blamed_on_the_setting_that_brought_it(
    tmp_path: Path, settings: list[str], expected: list[str]
) -> None:
    assert _faults(tmp_path, *settings) == expected


def test_a_fault_of_the_file_stays_the_files(tmp_path: Path) -> None:
    found = _faults(tmp_path, "surgeon.copies=0", more="fnord: 1\nseed: x\n")
    assert found == [
        "s.yaml: line 6: fnord: unknown key (got 1)",
        "--set: surgeon.copies: must be at least 1 (got 0)",
        "s.yaml: line 7: seed: must be an integer (got 'x')",
    ]
    assert _faults(tmp_path, "seed=3", more="fnord: 1\n") == ["s.yaml: line 6: fnord: unknown key (got 1)"]


def test_options_of_their_own_and_sweeps_are_named_as_such(tmp_path: Path) -> None:
    found = _faults(tmp_path, "seed=4", seed=-1, duration_s=-2.0, swept=("surgeon.copies=99",))
    assert sorted(found) == [
        "--duration-s: must be greater than 0 (got -2.0)",
        "--seed: must be at least 0 (got -1)",
        "--sweep: surgeon.copies: must be at most 64 (got 99)",
    ]
    assert _faults(tmp_path, "surgeon.copies=0", swept=("surgeon.copies=99",)) == [
        "--sweep: surgeon.copies: must be at most 64 (got 99)"
    ]
    assert _faults(tmp_path, swept=("surgeon.copies=[",)) == [
        "--sweep: surgeon.copies: not YAML: did not find expected node content (got '[')"
    ]
    assert _faults(tmp_path, duration_s=0.01) == [
        "--duration-s: duration_s must contain at least one sample at rate_hz"
    ]


def test_what_is_given_mends_the_file(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(GOOD + "fnord: 1\nseed: x\n")
    assert resolve(str(tmp_path / "s.yaml"), ["fnord=null"], 5).seed == 5
