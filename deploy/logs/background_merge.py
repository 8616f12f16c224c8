"""``run.mcap`` made beside the summary: the two take about as long, and few machines have one core."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final, Protocol

from common.errors import DataError, Fault
from common.scenario import Scenario
from deploy.logs.alignment import Clocks
from deploy.logs.merge import Merged, partial_of
from deploy.logs.merge_run import Opening, logs_in, merge_run
from deploy.shell import run_dir as folder

_MIN_PROCESS_BYTES: Final = 8_000_000


class Merging(Protocol):
    """A merge that is under way, or still to be done."""

    def concluded(self) -> None:
        """Tell that summary and manifest lie in the run folder."""
        ...

    def merged(self) -> Merged:
        """Wait for the merged file; raises `DataError` when it cannot be made."""
        ...


@contextmanager
def merging(run_dir: Path, scenario: Scenario, clocks: Clocks, opening: Opening) -> Iterator[Merging]:
    """Merge a run's logs while the block summarises them; nothing is left of a block that fails.

    Large logs are merged in a process of their own.
    """
    work = (run_dir, scenario, clocks, opening)
    if sum(path.stat().st_size for path in logs_in(run_dir).values()) < _MIN_PROCESS_BYTES:
        yield _Here(work)
        return
    context = get_context("spawn")
    ours, its = context.Pipe()
    process = context.Process(target=_merge_beside, args=(its, *work), name="merge")
    process.start()
    its.close()
    try:
        yield _Beside(ours)
    except BaseException:
        process.terminate()
        raise
    finally:
        ours.close()
        process.join()
        partial_of(run_dir / folder.MERGED_FILE).unlink(missing_ok=True)


class _Here:
    """Merges when it is asked for the result."""

    def __init__(self, work: tuple[Path, Scenario, Clocks, Opening]) -> None:
        self._work = work

    def concluded(self) -> None:
        pass

    def merged(self) -> Merged:
        return merge_run(*self._work)


class _Beside:
    """The other end of `_merge_beside`."""

    def __init__(self, process: Connection) -> None:
        self._process = process

    def concluded(self) -> None:
        with suppress(OSError):  # it has failed already, and says so below
            self._process.send(None)

    def merged(self) -> Merged:
        try:
            found: Merged | tuple[Fault, ...] = self._process.recv()
        except EOFError:
            raise DataError(
                Fault(folder.MERGED_FILE, "", "cannot be made: the process that merges was killed")
            ) from None
        if isinstance(found, Merged):
            return found
        raise DataError(found)


def _merge_beside(
    summarising: Connection, run_dir: Path, scenario: Scenario, clocks: Clocks, opening: Opening
) -> None:
    with suppress(EOFError, BrokenPipeError, KeyboardInterrupt):  # who summarises has given up
        try:
            summarising.send(merge_run(run_dir, scenario, clocks, opening, summarising.recv))
        except DataError as error:
            summarising.send(error.faults)
