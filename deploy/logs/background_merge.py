"""Merge of ``run.mcap`` in the background, parallel to the summary, which takes about as long."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final, Protocol

from tis.common.errors import DataError, Fault
from tis.common.scenario import Scenario
from tis.deploy.logs.alignment import Clocks
from tis.deploy.logs.merge import Merged, partial_of
from tis.deploy.logs.merge_run import Opening, logs_in, merge_run
from tis.deploy.shell import run_dir as folder

_MIN_PROCESS_BYTES: Final = 8_000_000


class Merging(Protocol):
    """A merge that is running, or pending."""

    def concluded(self) -> None:
        """Signal that summary and manifest are in the run folder."""
        ...

    def merged(self) -> Merged:
        """Wait for the merged file; raises `DataError` when the merge fails."""
        ...


@contextmanager
def merging(run_dir: Path, scenario: Scenario, clocks: Clocks, opening: Opening) -> Iterator[Merging]:
    """Merge a run's logs while the block summarises them; a block that fails leaves no file.

    Large logs are merged in a separate process.
    """
    work = (run_dir, scenario, clocks, opening)
    if sum(path.stat().st_size for paths in logs_in(run_dir).values() for path in paths) < _MIN_PROCESS_BYTES:
        yield _Inline(work)
        return
    # a forked child would inherit locks that other threads hold
    context = get_context("spawn")
    ours, its = context.Pipe()
    process = context.Process(target=_merge_process, args=(its, *work), name="merge")
    process.start()
    # the parent keeps no copy of the child's end, or a killed child would not show as EOF
    its.close()
    try:
        yield _Background(ours)
    except BaseException:
        process.terminate()
        raise
    finally:
        ours.close()
        process.join()
        partial_of(run_dir / folder.MERGED_FILE).unlink(missing_ok=True)


class _Inline:
    """A pending merge that runs when the result is requested."""

    def __init__(self, work: tuple[Path, Scenario, Clocks, Opening]) -> None:
        self._work = work

    def concluded(self) -> None:
        pass

    def merged(self) -> Merged:
        return merge_run(*self._work)


class _Background:
    """The parent's end of `_merge_process`."""

    def __init__(self, process: Connection) -> None:
        self._process = process

    def concluded(self) -> None:
        with suppress(OSError):  # it has failed already; merged() reports it
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


def _merge_process(
    summarising: Connection, run_dir: Path, scenario: Scenario, clocks: Clocks, opening: Opening
) -> None:
    with suppress(EOFError, BrokenPipeError, KeyboardInterrupt):  # the parent has given up
        try:
            summarising.send(merge_run(run_dir, scenario, clocks, opening, summarising.recv))
        except DataError as error:
            summarising.send(error.faults)
