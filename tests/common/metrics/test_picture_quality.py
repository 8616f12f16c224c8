"""PSNR and SSIM against slow definitions, pixel by pixel and window by window."""

from math import inf, log10

import numpy as np
import pytest

from tis.common.metrics.sight import Picture, psnr_db, ssim


def noisy(seed: int = 1, std: float = 12.0, shape: tuple[int, int] = (22, 31)) -> tuple[Picture, Picture]:
    """Return a picture with noise, and its original, a ramp with an edge."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    ramp = np.stack([4 * rows + columns, 3 * columns, 90 * (columns > rows)], axis=2)
    noise = np.random.default_rng(seed).normal(0.0, std, ramp.shape)
    return np.clip(ramp + noise, 0, 255).astype(np.uint8), ramp.astype(np.uint8)


def test_psnr_counts_every_pixel() -> None:
    seen, original = noisy()
    squares = [(int(a) - int(b)) ** 2 for a, b in zip(seen.ravel(), original.ravel(), strict=True)]
    assert psnr_db(seen, original) == pytest.approx(10 * log10(255**2 / (sum(squares) / len(squares))), rel=1e-12)
    assert psnr_db(original, original) == inf


def luma(picture: Picture) -> np.ndarray:
    return np.asarray((77.0 * picture[..., 0] + 150.0 * picture[..., 1] + 29.0 * picture[..., 2] + 128) // 256)


def by_windows(seen: Picture, original: Picture) -> float:
    """Wang's formula of each window of 8 x 8, every 4 pixels, from means and covariances."""
    x, y, found = luma(seen), luma(original), []
    for i in range(0, x.shape[0] // 4 * 4 - 7, 4):
        for j in range(0, x.shape[1] // 4 * 4 - 7, 4):
            a, b = x[i : i + 8, j : j + 8].ravel(), y[i : i + 8, j : j + 8].ravel()
            (vxx, vxy), (_, vyy) = np.cov(a, b)
            c1, c2 = 6.5025, 58.5225
            mx, my = a.mean(), b.mean()
            found.append((2 * mx * my + c1) * (2 * vxy + c2) / ((mx**2 + my**2 + c1) * (vxx + vyy + c2)))
    return float(np.mean(found))


@pytest.mark.parametrize("std", [0.0, 3.0, 40.0])
def test_ssim_is_the_mean_of_all_windows(std: float) -> None:
    seen, original = noisy(std=std)
    assert ssim(seen, original) == pytest.approx(by_windows(seen, original), rel=1e-9)
    assert ssim(original, original) == pytest.approx(1.0, abs=1e-12)


def test_more_noise_is_less_alike() -> None:
    values = [ssim(*noisy(std=std)) for std in (0.0, 2.0, 8.0, 32.0)]
    assert values == sorted(values, reverse=True)


def test_pictures_of_other_sizes_are_refused() -> None:
    small, large = np.zeros((8, 8, 3), np.uint8), np.zeros((8, 9, 3), np.uint8)
    with pytest.raises(ValueError, match="same size"):
        psnr_db(small, large)
    with pytest.raises(ValueError, match="same size"):
        ssim(small, large)
    with pytest.raises(ValueError, match="8 x 8"):
        ssim(small[:7], small[:7])
