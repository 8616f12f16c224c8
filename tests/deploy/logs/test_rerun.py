"""Rerun's own checker on a merged file; skipped where Rerun is not installed (it is large)."""

import shutil
import subprocess
from pathlib import Path

import pytest

RERUN = shutil.which("rerun")
LAYOUT = Path(__file__).resolve().parents[3] / "deploy" / "rerun" / "tis.rbl"

pytestmark = pytest.mark.skipif(RERUN is None, reason="Rerun is not installed: pip install rerun-sdk")


def test_the_layout_is_one_of_the_application_tis() -> None:
    assert RERUN is not None
    show = [RERUN, "rrd", "print", "-v", str(LAYOUT)]
    printed = subprocess.run(show, capture_output=True, text=True, timeout=120, check=True).stdout
    store = "".join(printed.partition("store_id: StoreId(")[2].split()[:2])
    assert store == 'Blueprint,"tis",'
    assert printed.count("ViewBlueprint:class_identifier") >= 4


def test_rerun_finds_nothing_wrong_and_decodes_what_is_drawn(run_dir: Path, tmp_path: Path) -> None:
    assert RERUN is not None
    checked = subprocess.run(
        [RERUN, "mcap", "check", "--full", str(run_dir / "run.mcap")], capture_output=True, text=True, timeout=120
    )
    assert checked.returncode == 0, checked.stderr
    rows = [line.split() for line in checked.stdout.splitlines()]
    topics = {row[3]: row[0] for row in rows if len(row) > 3 and row[1].isdigit()}
    assert {"/mtm", "/psm", "/tf", "/log", "/paths/truth", "/patient/tis/ticks"} <= topics.keys()
    assert set(topics.values()) == {"ok"}
    target = tmp_path / "run.rrd"
    convert = [RERUN, "mcap", "convert", str(run_dir / "run.mcap"), "-o", str(target)]
    subprocess.run(convert, check=True, capture_output=True, timeout=120)
    show = [RERUN, "rrd", "print", "-v", str(target)]
    printed = subprocess.run(show, capture_output=True, text=True, timeout=120, check=True).stdout
    for column in ("/mtm@InstancePoses3D:translations", "/tf@Transform3D:translation", "/log@TextLog:text"):
        assert column in printed
