"""A run as numpy columns, for notebooks and scripts."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Final, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand, Side
from tis.common.errors import DataError, Fault, InputError
from tis.common.records import TICKS, TRUTH
from tis.common.scenario import Scenario
from tis.deploy.logs.read.columns import joined
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs, load_run, scenario_in
from tis.deploy.logs.read.packets import link_fates, link_releases
from tis.deploy.logs.read.side_log import OUTCOMES
from tis.deploy.report.subjects.age import ages_of_hand
from tis.deploy.report.subjects.network.key_figures import KeyFigures
from tis.deploy.report.subjects.network.link_books import link_books
from tis.deploy.report.subjects.orientation import WristTrack, wrist_track
from tis.deploy.report.subjects.tracking import HandTrack, track_of_hand
from tis.deploy.shell import run_dir as folder

Floats = NDArray[np.float64]
K = TypeVar("K")
V = TypeVar("V")
Flags = NDArray[np.bool_]
_DIRECTIONS: Final[tuple[Direction, ...]] = get_args(Direction)


class LazyMapping(Mapping[K, V]):
    """A mapping that builds its values at each access: the logs hold the columns in a quarter of the memory."""

    def __init__(self, keys: Collection[K], make: Callable[[K], V]) -> None:
        self._keys, self._make = keys, make

    def __getitem__(self, key: K) -> V:
        if key not in self._keys:
            raise KeyError(key)
        return self._make(key)

    def __iter__(self) -> Iterator[K]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)


@dataclass(frozen=True)
class Run:
    """The content of a run folder; `load` reads it.

    Instants are int64 ns of run time on netem's clock, positions are in m. The data of a missing log is empty. The
    names are stable across versions. What holds columns is a `Frame`: each is an attribute, like ``ticks.due_ns``.
    ``messages``, ``fates`` and ``releases`` build their arrays at each access, so bind an array to a name to use it
    twice.

    Attributes
    ----------
    run_dir, scenario
        The folder, and the scenario as the run resolved it.
    summary
        ``summary.json``, or None when the folder has none.
    problems
        A sentence for each missing or damaged log.
    tracks
        By hand: ``t_ns`` (T,), ``truth_m`` (T, 3), ``estimates`` by name (T, 3) with NaN for none, ``scored`` (T,).
    turns
        By hand: errors of the orientation methods at the same ticks, ``turn_rad`` (T, 3) by name, and so on.
    truth
        By hand, the complete recorded arm: ``sample_ns`` (N,), ``position_m`` (N, 3).
    ticks
        By side, the ticks of surgeon and patient in the order of the log, arrays (N,): number ``tick``, nominal
        instant ``due_ns``, begin ``begin_ns``, and ``missed``.
    ages
        By hand, the ticks at which the age of the freshest sample is known: ``t_ns`` and ``age_ns`` (N,).
    messages
        By side and key, messages sent and received in the order of the log, arrays (N,): ``seq``, ``sent_ns``,
        ``log_ns`` (when this side sent or received it), ``sample_ns``, ``command_sample_ns`` (of the command that an
        estimate answers) and ``fingerprint`` (a hash of the payload); -1 for no instant.
    fates
        By direction, netem's decision on each packet, key by key, with the columns of
        `tis.common.records.FateBatch`: ``key`` is an index into ``fates.keys``, ``outcome`` one into
        `tis.deploy.report.OUTCOMES`.
    releases
        By direction, when each packet and copy left netem, with the columns of `tis.common.records.ReleaseBatch`.
    logs
        All records by side and topic.

    Examples
    --------
    >>> run = load("runs/default_20260101_120000")  # doctest: +SKIP
    >>> track = run.tracks["left"]  # doctest: +SKIP
    >>> run.error_mm("hold")[track.scored].max()  # doctest: +SKIP
    """

    run_dir: Path
    scenario: Scenario
    summary: dict[str, Any] | None
    problems: tuple[str, ...]
    tracks: Mapping[Hand, HandTrack]
    turns: Mapping[Hand, WristTrack]
    truth: Mapping[Hand, Frame]
    ticks: Mapping[Side, Frame]
    ages: Mapping[Hand, Frame]
    messages: Mapping[Side, Mapping[str, Frame]]
    fates: Mapping[Direction, Frame]
    releases: Mapping[Direction, Frame]
    logs: RunLogs

    def error_mm(self, estimator: str, hand: Hand | None = None) -> Floats:
        """Return an estimator's distance to the truth (T,) in mm, NaN where it has no estimate.

        ``hand`` defaults to the scenario's first. Raises `InputError` for a hand or an estimator that the run does
        not have; the message names those it has.
        """
        errors_mm = {one: track.errors_mm for one, track in self.tracks.items()}
        return self._of_hand(errors_mm, hand, "estimator", estimator, "estimate")

    def error_deg(self, method: str, hand: Hand | None = None) -> Floats:
        """Return an orientation method's angle to the truth (T,) in degrees, NaN where it has no estimate.

        ``hand`` defaults to the scenario's first. Raises `InputError` for a hand or a method that the run lacks.
        """
        turns_deg = {one: turns.turns_deg for one, turns in self.turns.items()}
        return self._of_hand(turns_deg, hand, "method", method, "orientation")

    def _of_hand(
        self, errors: Mapping[Hand, Mapping[str, Floats]], hand: Hand | None, what: str, name: str, lacking: str
    ) -> Floats:
        wanted = self.scenario.source.hands[0] if hand is None else hand
        if wanted not in errors:
            raise InputError(Fault(str(self.run_dir), "hand", f"must be one of {', '.join(errors)}", wanted))
        if name not in errors[wanted]:
            known = ", ".join(errors[wanted]) or f"none: the patient's log holds no {lacking}"
            raise InputError(Fault(str(self.run_dir), what, f"must be one of {known}", name))
        return errors[wanted][name]

    def lost(self, direction: Direction) -> Flags:
        """Return whether each message offered to netem was lost (N,), key by key, without foreign messages.

        Messages in the gaps of a damaged log are left out, so the mean is the summary's ``loss_pct``. Empty without
        netem's log. Raises `InputError` for an unknown direction.
        """
        if direction not in get_args(Direction):
            rule = f"must be one of {', '.join(get_args(Direction))}"
            raise InputError(Fault("Run.lost", "direction", rule, direction))
        # the summary's own accounting, so that both give one loss
        books = link_books(self.logs, direction, self.scenario.session).keys
        found = [KeyFigures.of(one).account.lost for one in books if not one.foreign]
        return joined(found, np.bool_)


def load(run_dir: str | PathLike[str]) -> Run:
    """Read a run folder into numpy columns.

    Parameters
    ----------
    run_dir
        Folder of a live or twin run, complete or cut short.

    Returns
    -------
    Run
        The content of its logs; damaged logs as far as they can be read.

    Raises
    ------
    tis.common.errors.DataError
        When the folder is no run, has no log, has logs of different scenarios, or a file that is no log of tis.
    tis.common.errors.InputError
        When its scenario is not valid.

    Examples
    --------
    >>> run = load("runs/default_20260101_120000")  # doctest: +SKIP
    >>> 100 * run.lost("forward").mean()  # doctest: +SKIP

    Notes
    -----
    Oracle: the logs read record by record with the mcap package (tests/deploy/report/test_run_data).
    """
    path = Path(run_dir)
    logs = load_run(path)
    scenario = folder.read_scenario(path, scenario_in(logs))
    if not logs.sides:
        raise DataError(Fault(str(path), "", "holds no log"))
    hands: Sequence[Hand] = scenario.source.hands
    tracks = {hand: track_of_hand(logs, scenario, hand) for hand in hands}
    return Run(
        run_dir=path,
        scenario=scenario,
        summary=folder.read_json(path / folder.SUMMARY_FILE),
        problems=tuple(logs.problems()),
        tracks=tracks,
        turns={hand: wrist_track(logs, scenario, track, hand) for hand, track in tracks.items()},
        truth={hand: _truth(logs, hand) for hand in hands},
        ticks={side: logs.of(side, TICKS).at(slice(None)) for side in ("surgeon", "patient")},
        ages={hand: _ages(logs, hand) for hand in hands},
        messages={side: log.messages for side, log in logs.sides.items()},
        fates=LazyMapping(_DIRECTIONS, partial(link_fates, logs)),
        releases=LazyMapping(_DIRECTIONS, partial(link_releases, logs)),
        logs=logs,
    )


def _truth(logs: RunLogs, hand: Hand) -> Frame:
    rows = logs.of_hand("surgeon", TRUTH, hand)
    return Frame.of_arrays(sample_ns=rows.sample_ns, position_m=rows.position_m)


def _ages(logs: RunLogs, hand: Hand) -> Frame:
    t_ns, age_ns = ages_of_hand(logs, hand)
    return Frame.of_arrays(t_ns=t_ns, age_ns=age_ns)


__all__ = ["OUTCOMES", "Run", "load"]
