"""Machine-readable stamps in a picture: which frame it is, and which command it shows, as black and white cells.

A picture has two, in bands along its upper and lower edge, so that one that is made of two frames shows it.
A stamp has 88 bits: its own mark, the frame's number, the command's number plus 1, and a CRC-16. A cell has 16 x 16
pixels, a macroblock of jpeg and h264; its inner 8 x 8 are read.
"""

import struct
from binascii import crc_hqx
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.sight import CELL

Picture = NDArray[np.uint8]
"""Rows, columns and red, green, blue: (height, width, 3)."""

NO_COMMAND: Final = -1

_LAYOUT: Final = struct.Struct(">BII")
_N_BITS: Final = 8 * (_LAYOUT.size + 2)
_MARKS: Final = (0xA5, 0x5A)
_FIRST_CRC: Final = 0xFFFF
_BLACK, _WHITE, _MIDDLE = 16, 235, 125


class Stamp(NamedTuple):
    """What a stamp says."""

    frame: int
    command: int


def band_rows(width: int) -> int:
    """Return the height of a stamp's band in a picture of this width, in pixels."""
    return -(-_N_BITS // (width // CELL)) * CELL


def draw_stamps(picture: Picture, stamp: Stamp) -> None:
    """Draw a stamp into both bands; raises `ValueError` for a picture that has no room for them."""
    if not _has_room(picture):
        raise ValueError("a picture with stamps has at least 16 columns, and rows for both bands")
    rows, picture = band_rows(picture.shape[1]), _cells_of(picture)
    for band, mark in zip((picture[:rows], picture[-rows:]), _MARKS, strict=True):
        content = _LAYOUT.pack(mark, stamp.frame, stamp.command + 1)
        content += crc_hqx(content, _FIRST_CRC).to_bytes(2, "big")
        cells = np.zeros((rows // CELL, picture.shape[1] // CELL), dtype=np.uint8)
        cells.flat[:_N_BITS] = np.unpackbits(np.frombuffer(content, dtype=np.uint8))
        levels = np.where(cells, _WHITE, _BLACK).astype(np.uint8)
        band[:] = levels.repeat(CELL, axis=0).repeat(CELL, axis=1)[:, :, None]


def read_stamps(picture: Picture) -> tuple[Stamp | None, Stamp | None]:
    """Return what the upper and the lower stamp say, None for an unreadable one (inverse: `draw_stamps`)."""
    if not _has_room(picture):
        return None, None
    rows, picture = band_rows(picture.shape[1]), _cells_of(picture)
    top, bottom = (_read(*one) for one in zip((picture[:rows], picture[-rows:]), _MARKS, strict=True))
    return top, bottom


def _has_room(picture: Picture) -> bool:
    height, width, _ = picture.shape
    return bool(width >= CELL and height >= 2 * band_rows(width))


def _cells_of(picture: Picture) -> Picture:
    """Return a picture without the rest on its right, which belongs to no cell."""
    return picture[:, : picture.shape[1] // CELL * CELL]


def _read(band: Picture, mark: int) -> Stamp | None:
    # green has most of the brightness
    cells = band[:, :, 1].reshape(band.shape[0] // CELL, CELL, band.shape[1] // CELL, CELL)
    inner = cells[:, CELL // 4 : -CELL // 4, :, CELL // 4 : -CELL // 4]
    bits = inner.mean(axis=(1, 3)).reshape(-1)[:_N_BITS] > _MIDDLE
    content = np.packbits(bits).tobytes()
    if crc_hqx(content[:-2], _FIRST_CRC).to_bytes(2, "big") != content[-2:]:
        return None
    found, frame, command = _LAYOUT.unpack(content[:-2])
    return Stamp(frame, command - 1) if found == mark else None
