from io import StringIO

import pytest
from rich.console import Console

from tis.deploy.bench import cells
from tis.deploy.bench.cells import bench_cells


def test_each_kind_of_twin_has_a_row_beside_the_one_with_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cells, "_ESTIMATORS", (("hold", "damped_velocity"),))
    text = StringIO()
    (figures,) = bench_cells(3.0, 2, Console(file=text, width=120)).values()
    assert list(figures) == ["log files", "logs in memory", "no logs"]
    assert all(spent_s > 0 for spent_s in figures.values())
    assert "1.000" in text.getvalue()
    assert "hold, damped_velocity" in text.getvalue()
