"""The pictures that the screen showed, decoded again from the log, beside those that the camera drew."""

from base64 import b64decode
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import isnan
from pathlib import Path
from typing import Final, NamedTuple, get_args

import numpy as np

from tis.common.channels import Hand
from tis.common.errors import DataError
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.sight import psnr_db, ssim
from tis.common.runtime.chunk_writer import by_channel
from tis.common.runtime.log_parts import companion_logs
from tis.common.scenario import Scenario
from tis.common.sight.codec import decoder_of
from tis.common.sight.fragments import received
from tis.common.sight.picture import PATH_FRAMES, Pixel, Tools, draw, scene_of, seen_rows
from tis.common.sight.stamp import Picture, Stamp
from tis.common.sight_records import PICTURES
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.log_paths import log_files
from tis.deploy.logs.payloads import UNREADABLE, json_rows
from tis.deploy.logs.read.frame import Frame
from tis.deploy.report.subjects.pictures import Pictures
from tis.deploy.report.subjects.sight import Quality

_MOST: Final = 100
"""Pictures that are compared, evenly spaced: each takes some 10 ms."""
_MOST_DECODED: Final = 3000
"""Frames of h264 that are decoded for them, from the first one on."""
_MOST_DB: Final = 100.0
"""In place of the infinite ratio of equal pictures."""
_FAR: Final = 1 << 14
"""Beyond it a tool of a log that anybody wrote is not drawn."""


class SeenPicture(NamedTuple):
    """A picture as the screen decoded it; `original` is the one that our camera drew for its frame."""

    frame: int
    state: str
    seen: Picture
    draw: Callable[[], Picture]

    @property
    def original(self) -> Picture:
        """Return the picture that our camera drew, which nobody can draw of an external one."""
        return self.draw()


def quality(run_dir: Path, scenario: Scenario, found: Pictures) -> Quality | None:
    """Return how well the pictures were seen; None where the log lacks the frames, or the codec is not installed."""
    if run_dir == Path() or found.is_external:  # logs in memory keep no frames; nobody can draw those of others again
        return None
    rows = seen_rows(scene_of(scenario))
    pairs = [(one.seen[rows], one.original[rows]) for one in seen_pictures(run_dir, scenario, found, _MOST)]
    if not pairs:
        return None
    ratios_db = [min(psnr_db(*pair), _MOST_DB) for pair in pairs]
    alike = [ssim(*pair) for pair in pairs]
    return Quality(
        n=len(pairs),
        psnr_db=summarise(ratios_db, (5, 50), ("mean",)),
        ssim=summarise(alike, (5, 50), ("mean",)),
    )


def seen_pictures(
    run_dir: Path, scenario: Scenario, found: Pictures, most: int, wanted: Sequence[int] | None = None
) -> Iterator[SeenPicture]:
    """Yield pictures as they were shown, at most ``most`` evenly spaced ones, or those of the frames ``wanted``.

    The frames are decoded as the screen did: with the fragments that its log says had arrived.
    """
    sight = scenario.sight
    assert sight is not None
    shown = np.sort(found.seen.frame) if wanted is None else np.array(wanted)
    keep = {*shown[np.unique(np.linspace(0, len(shown) - 1, min(most, len(shown))).astype(int))].tolist()}
    at = {int(frame): i for i, frame in enumerate(found.screen.frame)}
    drawn = {int(frame): i for i, frame in enumerate(found.camera.frame)}
    try:
        decoder = decoder_of(sight)
        for n, (frame, data) in enumerate(_frames_sent(run_dir)):
            if not keep or n >= _MOST_DECODED or frame not in drawn:
                return
            is_wanted, i = frame in keep, at.get(frame)
            if not is_wanted and sight.codec == "jpeg":
                continue
            row = None if i is None else found.screen[i]
            n_parts = -(-len(data) // sight.fragment_bytes)
            parts = received(data, row["missing"], n_parts, sight.fragment_bytes) if row and row["fragments"] else []
            picture = decoder.decode(parts, len(data))
            if is_wanted and row and picture is not None:
                draw_again = partial(_original, scenario, found.camera, drawn[frame])
                yield SeenPicture(frame, row["state"], picture, draw_again)
            keep.discard(frame)
    except (*UNREADABLE, DataError, ImportError):  # what the log has cannot be decoded here
        return


def _original(scenario: Scenario, camera: Frame, i: int) -> Picture:
    path = [_tools(camera, k) for k in range(max(0, i - PATH_FRAMES + 1), i + 1)]
    return draw(scene_of(scenario), Stamp(int(camera.frame[i]), int(camera.command[i])), path)


def _tools(camera: Frame, i: int) -> Tools:
    left, right = (_pixel(camera.column(f"{hand}_x")[i], camera.column(f"{hand}_y")[i]) for hand in get_args(Hand))
    return left, right


def _pixel(x: float, y: float) -> Pixel | None:
    """Return a tool's place, None for an unknown one, which is NaN in the log."""
    return None if isnan(x + y) else (int(min(max(x, -_FAR), _FAR)), int(min(max(y, -_FAR), _FAR)))


def _frames_sent(run_dir: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the frames as they were sent, from the logs of patient and camera, without keeping them."""
    for path in (*log_files(run_dir).get("patient", ()), *companion_logs(run_dir, "patient")):
        if not path.is_file():
            continue
        file = LogFile(path)
        for block in file.blocks():
            for channel_id, which in by_channel(block.channel):
                if file.topic(channel_id) == PICTURES:
                    for rows in json_rows(block.payloads(which)):
                        yield from ((row["frame"], b64decode(row["data"])) for row in rows)
