"""Comparisons from Python: the cells of a study, computed or resumed, and the results as plain data and figures."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from tis.common.errors import DataError, Fault, InputError
from tis.common.extras import GET_PANDAS, GET_PARQUET, GET_REPORT, Extra
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.compute import compute, workers_of
from tis.deploy.compare.results.files import Results, arrow, figures_of, files_of, results_of, write_files
from tis.deploy.compare.study import Study, plan_study
from tis.deploy.shell.guard import ERR
from tis.deploy.shell.progress import PhaseProgress

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Comparison:
    """The result of a study.

    Attributes
    ----------
    study : Study
        What was compared.
    folder : pathlib.Path
        The folder of the cells, where the same study resumes.
    """

    study: Study
    folder: Path
    _results: Results = field(repr=False)

    @property
    def report(self) -> dict[str, Any]:
        """The content of ``table.json``.

        Pooled scores with 95 % intervals (``rows``), scores of each trial (``by_trial``), age and traffic of each
        setting (``settings``), and what ``failed``, in words.
        """
        return self._results.report

    @property
    def rows(self) -> tuple[Mapping[str, Any], ...]:
        """The tidy table, one row for each twin, hand and estimator, with a column for each axis.

        Numbers carry their unit in their name; what is unknown is None.
        """
        return tuple(self._results.rows)

    @property
    def pooled(self) -> list[dict[str, Any]]:
        """The pooled scores of each setting and estimator, with their intervals."""
        return list(self.report["rows"])

    @property
    def failed(self) -> list[str]:
        """The twins and trainings that failed, and twins without a scored tick, each with the reason."""
        return [*self.report["failed"], *self.report["unscored"]]

    def to_arrow(self) -> Any:
        """Return the tidy rows as a `pyarrow.Table`; raises `InputError` without pyarrow."""
        _require("pyarrow", "to_arrow", GET_PARQUET)
        return arrow(self.rows)

    def to_pandas(self) -> Any:
        """Return the tidy rows as a `pandas.DataFrame`; raises `InputError` without pandas."""
        _require("pandas", "to_pandas", GET_PANDAS)
        import pandas as pd

        return pd.DataFrame.from_records([dict(row) for row in self.rows])

    def figures(self) -> "dict[str, Figure]":
        """Return the figures by name, as of `matplotlib`; raises `InputError` without matplotlib."""
        _require("matplotlib", "figures", GET_REPORT)
        return figures_of(self.report)

    def write(self, folder: "str | PathLike[str] | None" = None) -> tuple[Path, ...]:
        """Write every form of the results as `tis compare` does, by default beside the cells; return the files.

        Raises `DataError` where the folder cannot be written.
        """
        path = self.folder if folder is None else Path(folder)
        files = files_of(self._results)
        write_files(files, path)
        return tuple(path / name for name in files.contents)


def compare(
    study: Study,
    out_dir: "str | PathLike[str] | None" = None,
    n_jobs: int | None = None,
    scheduler: str | None = None,
    progress: bool = False,
) -> Comparison:
    """Compute the twins of a study that the folder does not hold yet, and return the pooled results.

    A script must call it below ``if __name__ == "__main__":``, as the processes import the script.

    Parameters
    ----------
    study : Study
        What is compared.
    out_dir : path, optional
        Folder of the cells, by default ``runs/compare/SCENARIO``. A second call computes only what is missing.
    n_jobs : int, optional
        Number of processes, by default one for each core. The results do not depend on it.
    scheduler : str, optional
        Address of a Dask scheduler, ``tcp://HOST:8786``, whose workers compute instead.
    progress : bool
        Whether progress is printed on standard error.

    Returns
    -------
    Comparison
        The results. Twins that failed are in ``failed``; the others count.

    Raises
    ------
    InputError
        If the study cannot be computed, with all its faults.
    PeerError
        If the scheduler, or a worker of this version, is not there.
    DataError
        If recordings are missing, the folder cannot be written, or no twin could be computed.

    Notes
    -----
    Oracle: `tis compare` of the same study, tests/deploy/compare/test_comparison.
    """
    if not isinstance(study, Study):
        raise InputError(Fault("compare", "study", "must be a Study", type(study).__name__))
    plan = plan_study(study)
    console = ERR if progress else Console(quiet=True)
    with workers_of(n_jobs, scheduler, console.print) as workers, PhaseProgress(console) as shown:
        store = Store(Path("runs") / "compare" / plan.name if out_dir is None else Path(out_dir))
        outcome = compute(plan.cells, plan.trainings, store, workers, shown)
    fields = study.model_dump(mode="json", exclude_unset=True)
    call = f"compare(Study({', '.join(f'{name}={value!r}' for name, value in fields.items())}))"
    results = results_of(plan, outcome, call)
    if not outcome.cells:
        raise DataError([Fault("", "", text) for text in results.report["failed"]])
    return Comparison(study, store.path, results)


def _require(package: str, method: str, command: Extra) -> None:
    if find_spec(package) is None:
        raise InputError(Fault(f"Comparison.{method}", "", f"needs {package}: {command}"))
