"""A run as numpy columns, for notebooks and scripts."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand, Side
from tis.common.errors import DataError, Fault, InputError
from tis.common.metrics.tracking import angles_deg
from tis.common.records import TICKS, TRUTH
from tis.common.scenario import Scenario
from tis.common.units import MM_PER_M
from tis.deploy.logs.read.batches import OUTCOMES, Fates, Releases, link_fates, link_releases
from tis.deploy.logs.read.load import Ints, RunLogs, load_run
from tis.deploy.logs.read.message_columns import MessageColumns
from tis.deploy.logs.read.recorded import scenario_in
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


class Ticks(NamedTuple):
    """A side's ticks in the order of its log, arrays (N,): number, nominal instant and begin in ns, missed or not."""

    tick: Ints
    due_ns: Ints
    begin_ns: Ints
    missed: Flags


class Samples(NamedTuple):
    """The recorded arm of one hand: sample instants (N,) in ns, positions (N, 3) in m."""

    sample_ns: Ints
    position_m: Floats


class Messages(NamedTuple):
    """The messages of one key that a side sent or received, in the order of its log; arrays (N,), ns.

    ``log_ns`` is the instant of sending or receiving on this side, ``sample_ns`` the sample instant and
    ``command_sample_ns`` the sample instant of the command that an estimate answers; -1 where there is none.
    """

    seq: Ints
    sent_ns: Ints
    log_ns: Ints
    sample_ns: Ints
    command_sample_ns: Ints


class Ages(NamedTuple):
    """The ticks of one hand at which an age is known: tick instants (N,) and ages (N,), in ns."""

    t_ns: Ints
    age_ns: Ints


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
    names are stable across versions. ``messages``, ``fates`` and ``releases`` build their arrays at each access, so
    bind an array to a name to use it twice.

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
        By hand: the complete recorded arm.
    ticks
        By side: the ticks of surgeon and patient.
    ages
        By hand: the age of the freshest sample at each tick.
    messages
        By side and key: messages sent and received.
    fates
        By direction: netem's decision on each packet; ``outcome`` is an index into `tis.deploy.report.OUTCOMES`.
    releases
        By direction: when each packet and copy left netem.
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
    truth: Mapping[Hand, Samples]
    ticks: Mapping[Side, Ticks]
    ages: Mapping[Hand, Ages]
    messages: Mapping[Side, Mapping[str, Messages]]
    fates: Mapping[Direction, Fates]
    releases: Mapping[Direction, Releases]
    logs: RunLogs

    def error_mm(self, estimator: str, hand: Hand | None = None) -> Floats:
        """Return an estimator's distance to the truth (T,) in mm, NaN where it has no estimate.

        ``hand`` defaults to the scenario's first. Raises `InputError` for a hand or an estimator that the run does
        not have; the message names those it has.
        """
        wanted = self.scenario.source.hands[0] if hand is None else hand
        if wanted not in self.tracks:
            raise InputError(Fault(str(self.run_dir), "hand", f"must be one of {', '.join(self.tracks)}", wanted))
        track = self.tracks[wanted]
        if estimator not in track.estimates:
            known = ", ".join(track.estimates) or "none: the patient's log holds no estimate"
            raise InputError(Fault(str(self.run_dir), "estimator", f"must be one of {known}", estimator))
        return MM_PER_M * np.asarray(np.linalg.norm(track.estimates[estimator] - track.truth_m, axis=1))

    def error_deg(self, method: str, hand: Hand | None = None) -> Floats:
        """Return an orientation method's angle to the truth (T,) in degrees, NaN where it has no estimate.

        ``hand`` defaults to the scenario's first. Raises `InputError` for a hand or a method that the run lacks.
        """
        wanted = self.scenario.source.hands[0] if hand is None else hand
        if wanted not in self.turns:
            raise InputError(Fault(str(self.run_dir), "hand", f"must be one of {', '.join(self.turns)}", wanted))
        errors = self.turns[wanted].turn_rad
        if method not in errors:
            known = ", ".join(errors) or "none: the patient's log holds no orientation"
            raise InputError(Fault(str(self.run_dir), "method", f"must be one of {known}", method))
        return angles_deg(errors[method])

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
        return np.concatenate([np.empty(0, dtype=np.bool_), *found])


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
        truth={hand: _samples(logs, hand) for hand in hands},
        ticks={side: _ticks(logs, side) for side in ("surgeon", "patient")},
        ages={hand: Ages(*ages_of_hand(logs, hand)) for hand in hands},
        messages={side: _messages(log.messages) for side, log in logs.sides.items()},
        fates=LazyMapping(_DIRECTIONS, partial(link_fates, logs)),
        releases=LazyMapping(_DIRECTIONS, partial(link_releases, logs)),
        logs=logs,
    )


def _ticks(logs: RunLogs, side: Side) -> Ticks:
    rows = logs.columns(side, TICKS)
    return Ticks(*(rows.column(name) for name in Ticks._fields))


def _samples(logs: RunLogs, hand: Hand) -> Samples:
    rows = logs.columns("surgeon", TRUTH)
    its = rows.where("hand", hand)
    return Samples(rows.column("sample_ns")[its], rows.column("position_m")[its])


def _messages(known: Mapping[str, MessageColumns]) -> Mapping[str, Messages]:
    return LazyMapping(known, lambda key: Messages(*(getattr(known[key], name) for name in Messages._fields)))


__all__ = ["OUTCOMES", "Ages", "Messages", "Run", "Samples", "Ticks", "load"]
