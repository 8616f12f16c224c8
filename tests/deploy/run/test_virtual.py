"""What `tis twin --against` says of the comparison, in words."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK
from tis.deploy.run import virtual
from tis.deploy.run.conclude import Outputs
from tis.deploy.run.consistency import FateComparison
from tis.deploy.run.resolve import resolve


def _said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: FateComparison | None) -> tuple[int, str, str]:
    """Return what a twin says that is held against another twin; ``found`` takes the place of the comparison."""
    scenario = resolve("default", ["estimators=[hold]", "active_estimator=hold"], None, 3.0)
    quiet = Console(quiet=True)
    virtual.run_virtual(scenario, tmp_path / "one", None, quiet, quiet, Outputs(report=False))
    if found is not None:
        monkeypatch.setattr(virtual, "compare_fates", lambda *_: found)
    out, err = io.StringIO(), io.StringIO()
    consoles = Console(file=out, width=500), Console(file=err, width=500)
    code = virtual.run_virtual(scenario, tmp_path / "two", tmp_path / "one", *consoles, Outputs(report=False))
    return code, out.getvalue().strip().splitlines()[-1], err.getvalue()


def test_equal_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code, line, err = _said(tmp_path, monkeypatch, None)
    assert code == EXIT_OK
    assert line.endswith(f" fates compared with {tmp_path / 'one'}: 0 differ; 0 packets were offered in one run only")
    assert int(line.split()[0]) > 300
    assert "warning" not in err


@pytest.mark.parametrize(("n_set_aside", "warns"), [(5, False), (6, True)])
def test_the_causes_are_named_and_much_set_aside_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, n_set_aside: int, warns: bool
) -> None:
    found = FateComparison(100 - n_set_aside, 1, n_moved=40, n_set_aside=n_set_aside, n_in_one_only=2)
    code, line, err = _said(tmp_path, monkeypatch, found)
    assert code == EXIT_INVALID_RUN
    assert "1 differ; 2 packets were offered in one run only; 40 were offered in another ms of run time" in line
    assert f"{n_set_aside} were set aside: the network was changed while running" in line
    assert ("warning: 6% of the packets were set aside" in err) is warns
