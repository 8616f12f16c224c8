"""A short campaign against screen and decoders; CONTRIBUTING.md has the command of a long one."""

import pytest


def test_no_fragment_and_no_frame_ends_the_screen() -> None:
    pytest.importorskip("PIL", reason="the extra report is not installed")
    pytest.importorskip("av", reason="the extra video is not installed")
    from tests.fuzz.sight import fuzz

    found = fuzz(1500, seed=2)
    assert found["h264: picture"] > 20
    assert found["external jpeg: picture"] > 20
    assert found["jpeg screen: complete"] > 0
    assert found["jpeg screen: video_forged"] > 0
