"""Two checkouts measured in turn; here the other is a script that writes the figures of `tis bench netem`."""

import io
import json
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tis.common.errors import InputError
from tis.deploy.bench import netem


def _figures(hop_us: float) -> dict[str, Any]:
    errors = [{"p50": 1.0, "p99": 40.0}]
    return {
        "hop_us": {"netem_p50": [hop_us], "ratio": hop_us / 100},
        "cpu_1khz_us": {"in_order": [80.0], "native": [50.0]},
        "release_error_1khz_us": {"in_order": errors, "reordered": errors},
        "release_error_10khz_p99_us": [50.0],
        "unthrottled_hz": {"netem": 30_000.0},
    }


def _command(path: Path, hop_us: float) -> Path:
    path.write_text(f"#!{sys.executable}\nopen('f.json', 'w').write({json.dumps(_figures(hop_us))!r})\n")
    path.chmod(0o755)
    return path


def test_both_are_measured_in_turn_and_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here, there = _command(tmp_path / "here", 120.0), _command(tmp_path / "there", 100.0)
    monkeypatch.setattr(sys, "executable", str(here))
    out = io.StringIO()
    found = netem.bench_beside(there, 1.0, 3, Console(file=out, width=200))
    assert [len(found[name]) for name in ("here", "beside")] == [3, 3]
    (hop,) = (line for line in out.getvalue().splitlines() if "one hop" in line)
    assert hop.split()[-1] == "1.20x"


def test_what_cannot_be_measured_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nobody: cannot be measured: No such file or directory"):
        netem._whole_bench([str(tmp_path / "nobody")], 1.0)
    broken = tmp_path / "broken"
    broken.write_text("#!/bin/sh\necho no module >&2; exit 1\n")
    broken.chmod(0o755)
    with pytest.raises(InputError, match="broken: cannot be measured: no module"):
        netem._whole_bench([str(broken)], 1.0)
