"""Seeded fuzzing of whole sides through their entry points, in virtual time: no packet ends a run.

``python -m tests.fuzz.whole_sides --seconds N [--seed S] [--door NAME] [--episodes N]``. An episode is one run of one
side under fire; all of it follows from its seed. ``--seed S --door NAME --episodes 1`` repeats the one of an exit.
"""

import argparse
import gc
import random
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Final, NamedTuple

from tests.fuzz.control_door import control_episode
from tests.fuzz.episode import Episode
from tests.fuzz.patient_door import patient_episode
from tests.fuzz.surgeon_door import surgeon_episode

_ROOT: Final = Path(__file__).resolve().parents[2]
_MS_PER_S: Final = 1e3

DOORS: Final[Mapping[str, Callable[..., Iterator[None]]]] = {
    "patient": patient_episode,
    "surgeon": surgeon_episode,
    "control": control_episode,
}


class Exit(NamedTuple):
    """An exception that escaped: the first seed with it, and what its side was given last."""

    seed: int
    step: int
    place: str
    error: str
    last: str
    trace: str


class Longest(NamedTuple):
    """The longest step, in s by the clock; what of it was this thread's processor time, and the collector's."""

    wall_s: float = 0.0
    processor_s: float = 0.0
    collector_s: float = 0.0
    seed: int = -1
    last: str = ""


@dataclass
class Tally:
    """What a door's episodes came to."""

    door: str
    n_episodes: int = 0
    n_steps: int = 0
    n_messages: int = 0
    n_used: int = 0
    exits: dict[tuple[str, str], Exit] = field(default_factory=dict)
    n_exits: Counter[tuple[str, str]] = field(default_factory=Counter)
    longest: Longest = field(default_factory=Longest)


class Collector:
    """The time that garbage collection takes."""

    def __init__(self) -> None:
        self.spent_s = 0.0
        self._begun_s = 0.0

    def __call__(self, phase: str, info: Any) -> None:
        if phase == "start":
            self._begun_s = time.perf_counter()
        else:
            self.spent_s += time.perf_counter() - self._begun_s


def fuzz(door: str, seed: int, until: Callable[[Tally], bool], quick: bool = False) -> Tally:
    """Run the episodes of a door from ``seed`` on, until ``until`` tells to stop."""
    tally, collector = Tally(door), Collector()
    gc.callbacks.append(collector)
    try:
        for one in count(seed):
            if until(tally):
                return tally
            _episode(tally, one, partial(DOORS[door], quick=quick), collector)
    finally:
        gc.callbacks.remove(collector)
    return tally


def _episode(tally: Tally, seed: int, door: Callable[[Episode], Iterator[None]], collector: Collector) -> None:
    episode, step = Episode(random.Random(f"{tally.door}/{seed}")), 0
    steps = door(episode)
    try:
        next(steps)  # the set-up
        while True:
            begun, spent_s = (time.perf_counter(), time.thread_time()), collector.spent_s
            next(steps)
            wall_s = time.perf_counter() - begun[0]
            if wall_s > tally.longest.wall_s:
                processor_s, collector_s = time.thread_time() - begun[1], collector.spent_s - spent_s
                tally.longest = Longest(wall_s, processor_s, collector_s, seed, episode.last)
            step += 1
    except StopIteration:
        pass
    except Exception as error:
        place = _place(error)
        key = (place, type(error).__name__)
        tally.n_exits[key] += 1
        found = Exit(seed, step, place, repr(error)[:300], episode.last, traceback.format_exc())
        tally.exits.setdefault(key, found)
    finally:
        steps.close()  # type: ignore[attr-defined]
    tally.n_episodes += 1
    tally.n_steps += step
    tally.n_messages += episode.n_messages
    tally.n_used += episode.n_used


def _place(error: BaseException) -> str:
    """Return the innermost function of the project in a traceback."""
    place = "?"
    for frame in traceback.extract_tb(error.__traceback__):
        path = Path(frame.filename)
        if path.is_relative_to(_ROOT) and ".venv" not in path.parts:
            place = f"{path.relative_to(_ROOT)}:{frame.name}"
    return place


def table(tallies: list[Tally]) -> str:
    """Return a line per door, then the exits and the messages of the longest steps."""
    names = "door episodes executions messages used exits longest_ms of_it_processor_ms of_it_collector_ms"
    rows = [names.split()]
    for one in tallies:
        counts = (one.n_episodes, one.n_steps, one.n_messages, one.n_used, sum(one.n_exits.values()))
        times = (one.longest.wall_s, one.longest.processor_s, one.longest.collector_s)
        rows.append([one.door, *map(str, counts), *(f"{_MS_PER_S * each:.1f}" for each in times)])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    for tally in tallies:
        lines.append(f"{tally.door}: longest step in seed {tally.longest.seed}, after {tally.longest.last[:300]}")
        for key, found in tally.exits.items():
            lines.append(f"EXIT {tally.door} x{tally.n_exits[key]}: {found.error} at {found.place}")
            lines.append(f"  python -m tests.fuzz.whole_sides --door {tally.door} --seed {found.seed} --episodes 1")
            lines.append(f"  step {found.step}, last given: {found.last}")
    return "\n".join(lines)


def main() -> int:
    """Fuzz the doors one after the other; return 1 if anything escaped."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.whole_sides")
    parser.add_argument("--seconds", type=float, default=60.0, help="time for each door")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first episode")
    parser.add_argument("--door", choices=list(DOORS), action="append", help="this door only")
    parser.add_argument("--episodes", type=int, help="end after so many episodes; their tracebacks are printed")
    options = parser.parse_args()
    tallies = []
    for door in options.door or list(DOORS):
        end_s = time.monotonic() + options.seconds
        most = options.episodes

        def is_over(tally: Tally, end_s: float = end_s, most: int | None = most) -> bool:
            return time.monotonic() >= end_s or (most is not None and tally.n_episodes >= most)

        tallies.append(fuzz(door, options.seed, is_over))
        if most is not None:
            for found in tallies[-1].exits.values():
                print(found.trace)  # noqa: T201
    print(table(tallies))  # noqa: T201
    return int(any(tally.exits for tally in tallies))


if __name__ == "__main__":
    sys.exit(main())
