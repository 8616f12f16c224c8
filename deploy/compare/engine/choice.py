"""Choice of the workers of a comparison."""

from collections.abc import Callable

from tis.common.errors import Fault, InputError
from tis.deploy.compare.engine.cluster import Cluster
from tis.deploy.compare.engine.processes import Processes
from tis.deploy.compare.engine.workers import Workers


def workers_of(n_jobs: int | None, scheduler: str | None, notify: Callable[[str], None]) -> Workers:
    """Return the workers of a cluster where a ``scheduler`` is named, otherwise processes; raises `InputError`.

    ``notify`` prints notices on the cluster.
    """
    if n_jobs is not None and scheduler is not None:
        rule = "must be given without --scheduler: the number of Dask's workers decides"
        raise InputError(Fault("--jobs", "", rule, n_jobs))
    if n_jobs is not None and (not isinstance(n_jobs, int) or n_jobs < 1):
        raise InputError(Fault("--jobs", "", "must be a whole number of at least 1", n_jobs))
    if scheduler is None:
        return Processes(n_jobs)
    return Cluster(scheduler, notify)
