"""Quality of a picture against its original: PSNR, and the structural similarity (SSIM).

SSIM after Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: from error visibility to structural
similarity" (2004), with equal weights in windows of 8 x 8 pixels, one every 4 pixels, as x264 and the filter of
FFmpeg take it; their sums are sums of blocks of 4 x 4, so it is fast. On brightness alone.
"""

from math import inf, log10
from typing import Final

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
"""Red, green and blue, (height, width, 3)."""
Plane = NDArray[np.int32]

_WHITE: Final = 255.0
_BLOCK: Final = 4
_PIXELS: Final = 64
_C1: Final = (0.01 * _WHITE) ** 2
_C2: Final = (0.03 * _WHITE) ** 2
_LUMA: Final = (77, 150, 29)
"""BT.601's weights of red, green and blue, in 256ths; in integers every sum is exact."""


def psnr_db(seen: Picture, original: Picture) -> float:
    """Return the peak signal-to-noise ratio over all pixels and colours, in dB; infinite for equal pictures.

    Raises `ValueError` for pictures of different size. Oracle: pixel by pixel, test_picture_quality.
    """
    _alike(seen, original)
    off = seen.astype(np.int16) - original
    mean = int(np.square(off, dtype=np.int32).sum(dtype=np.int64)) / off.size
    return 10.0 * log10(_WHITE**2 / mean) if mean > 0.0 else inf


def ssim(seen: Picture, original: Picture) -> float:
    """Return the mean structural similarity of the brightness (BT.601), 1 for equal pictures.

    Rows and columns beyond a multiple of 4 are left out; raises `ValueError` for pictures of different size or below
    8 x 8. Oracle: window by window, test_picture_quality.
    """
    _alike(seen, original)
    if min(seen.shape[:2]) < 2 * _BLOCK:
        raise ValueError(f"a picture must have 8 x 8 pixels at least (got {seen.shape[1]} x {seen.shape[0]})")
    x, y = _luma(seen), _luma(original)
    mean_x, mean_y = (_windows(one) / _PIXELS for one in (x, y))
    # variances and the covariance about the windows' means, divided by n - 1 as there
    var_x, var_y, cov = (
        (_windows(one * other) - _PIXELS * mean * mean_of_other) / (_PIXELS - 1)
        for one, other, mean, mean_of_other in (
            (x, x, mean_x, mean_x),
            (y, y, mean_y, mean_y),
            (x, y, mean_x, mean_y),
        )
    )
    alike = (2.0 * mean_x * mean_y + _C1) * (2.0 * cov + _C2)
    return float(np.mean(alike / ((mean_x**2 + mean_y**2 + _C1) * (var_x + var_y + _C2))))


def _luma(picture: Picture) -> Plane:
    red, green, blue = (weight * picture[..., i].astype(np.int32) for i, weight in enumerate(_LUMA))
    return np.asarray((red + green + blue + 128) >> 8)


def _windows(plane: Plane) -> Plane:
    """Return the sums of the windows of 8 x 8 at every fourth pixel."""
    n_rows, n_columns = (n // _BLOCK for n in plane.shape)
    cut = plane[: n_rows * _BLOCK, : n_columns * _BLOCK]
    # twice one axis is much faster than both at once
    rows = cut.reshape(n_rows, _BLOCK, -1).sum(axis=1, dtype=np.int32)
    blocks = sum(rows[:, at::_BLOCK] for at in range(_BLOCK))
    pairs = blocks[:-1] + blocks[1:]
    return np.asarray(pairs[:, :-1] + pairs[:, 1:])


def _alike(seen: Picture, original: Picture) -> None:
    if seen.shape != original.shape or seen.ndim != 3:
        raise ValueError(f"pictures must have the same size (got {seen.shape} and {original.shape})")
