"""Replay of the screen: fragments, rebuilt from the camera's log, arrive as the surgeon's log says they did."""

from base64 import b64decode
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from msgspec import DecodeError
from msgspec.structs import replace

from tis.common.channels import VIDEO
from tis.common.messages import Fragment, Header, decode
from tis.common.node import Arrival, Output, Record
from tis.common.runtime.log_parts import companion_logs, part_clock
from tis.common.scenario import Scenario
from tis.common.sight.fragments import cut
from tis.common.sight_records import PICTURES, SCREEN, ScreenNote
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.log_paths import log_files
from tis.deploy.logs.payloads import other_version
from tis.deploy.logs.read.load import load_run
from tis.surgeon_side.screen import build_screen


class Logged(NamedTuple):
    """What a log holds of a screen: its fragments as they arrived, and what it made of the frames."""

    fragments: list[tuple[int, Header, Fragment]]
    notes: list[ScreenNote]
    joined_ns: int


def replay_screen(run_dir: Path, scenario: Scenario) -> tuple[int, int, int]:
    """Return the numbers of frames compared with those of the logs, of different ones, and of those in one only.

    The instant of a refresh is compared as whether there was one: live a refresh is as late as its loop.
    """
    pictures = load_run(run_dir, {PICTURES}).of("patient", PICTURES)
    sent = {row["frame"]: (row["captured_ns"], b64decode(row["data"])) for row in pictures}
    n_compared = n_different = n_absent = 0
    for path in (*log_files(run_dir).get("surgeon", ()), *companion_logs(run_dir, "surgeon")):
        logged = read_logged(path, scenario)
        found = {note.frame: _timeless(note) for note in replayed_notes(logged, scenario, sent)}
        known = {note.frame: _timeless(note) for note in logged.notes}
        both = found.keys() & known.keys()
        n_compared += len(both)
        n_different += sum(found[frame] != known[frame] for frame in both)
        n_absent += len(found.keys() ^ known.keys())
    return n_compared, n_different, n_absent


def _timeless(note: ScreenNote) -> ScreenNote:
    return note if note.shown_ns is None else replace(note, shown_ns=0)


def read_logged(path: Path, scenario: Scenario) -> Logged:
    """Return what a log holds of a screen."""
    file, found, key = LogFile(path), Logged([], [], 0), VIDEO.key(scenario.session)
    try:
        for block in file.blocks():
            columns = (block.channel, block.seq, block.publish_ns, block.log_ns)
            rows = zip(*(one.tolist() for one in columns), block.payloads(slice(None)), strict=True)
            for channel, seq, sent_ns, log_ns, payload in rows:
                if file.topic(channel) == key:
                    found.fragments.append((log_ns, Header(seq, sent_ns), decode(payload, Fragment)))
                elif file.topic(channel) == SCREEN:
                    found.notes.append(decode(payload, ScreenNote))
    except DecodeError:
        raise other_version(SCREEN) from None
    clock = part_clock({name: one.data for name, one in file.attachments.items()})
    return found._replace(joined_ns=0 if clock is None else clock.joined_ns or 0)


def replayed_notes(logged: Logged, scenario: Scenario, sent: dict[int, tuple[int, bytes]]) -> Iterator[ScreenNote]:
    """Yield what a screen makes of the fragments; one that the camera did not send stays away."""
    assert scenario.sight is not None
    size, node, key = scenario.sight.fragment_bytes, build_screen(scenario), VIDEO.key(scenario.session)

    @cache
    def payloads(frame: int) -> list[tuple[bytes, Fragment]]:
        return list(cut(frame, *sent[frame], size)) if frame in sent else []

    def notes(outputs: list[Output]) -> Iterator[ScreenNote]:
        return (one.data for one in outputs if isinstance(one, Record) and isinstance(one.data, ScreenNote))

    node.join(0, logged.joined_ns)
    for recv_ns, header, said in logged.fragments:
        while (due_ns := node.next_wake_ns()) is not None and due_ns < recv_ns:
            yield from notes([*node.wake(due_ns)])
        parts = payloads(said.frame)
        if said.index < len(parts) and parts[said.index][1] == said:
            yield from notes([*node.receive(Arrival("west", key, parts[said.index][0], header.pack(), recv_ns))])
    # The last refresh of a run that Ctrl-C ended is known by what it showed: one that was due may not have come.
    last_ns = max((note.shown_ns for note in logged.notes if note.shown_ns is not None), default=0)
    while (due_ns := node.next_wake_ns()) is not None and due_ns <= last_ns:
        yield from notes([*node.wake(due_ns)])
    yield from notes([*node.finish(scenario.end_ns)])
