from typing import Any

import pytest

from tis.common.errors import InputError
from tis.deploy.compare.engine.cluster import Cluster
from tis.deploy.compare.engine.compute import workers_of
from tis.deploy.compare.engine.workers import Processes


def test_a_scheduler_stands_for_a_cluster() -> None:
    assert isinstance(workers_of(None, None, print), Processes)
    assert isinstance(workers_of(2, None, print), Processes)
    assert isinstance(workers_of(None, "tcp://127.0.0.1:8786", print), Cluster)


@pytest.mark.parametrize("n_jobs", [0, -1, "2", 1.5])
def test_a_number_of_processes_is_a_whole_one(n_jobs: Any) -> None:
    with pytest.raises(InputError, match="--jobs: must be a whole number of at least 1"):
        workers_of(n_jobs, None, print)


def test_processes_and_a_scheduler_exclude_each_other() -> None:
    with pytest.raises(InputError, match="--jobs: must be given without --scheduler"):
        workers_of(2, "tcp://127.0.0.1:8786", print)
