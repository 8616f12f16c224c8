"""Encoders that repeat bit for bit, and decoders that make the best of what arrives."""

from io import BytesIO
from random import Random
from typing import Any

import numpy as np
import pytest

from tis.common.errors import InputError
from tis.common.scenario.sight import SightPart
from tis.common.sight import codec
from tis.common.sight.codec import Encoded, check_codec, codec_versions, decoder_of, encoder_of, is_key, whole_units
from tis.common.sight.picture import Scene, draw, seen_rows
from tis.common.sight.stamp import Picture, Stamp, read_stamps
from tis.deploy.run.resolve import resolve

SCENE = Scene(320, 240, 150, yields=True)
PICTURES: list[Picture] = [
    draw(SCENE, Stamp(k, 3 * k), [((80 + 2 * i, 100 + i), None) for i in range(k + 1)]) for k in range(40)
]


@pytest.fixture(params=["jpeg", "h264", "intra_refresh"])
def sight(request: pytest.FixtureRequest) -> SightPart:
    pytest.importorskip("PIL" if request.param == "jpeg" else "av", reason="the extra is not installed")
    kind: dict[str, Any] = {"codec": request.param}
    if request.param == "intra_refresh":
        kind = {"codec": "h264", "intra_refresh": True}
    return SightPart(width=320, height=240, key_every=10, bit_rate_kbit_s=1000, **kind)


def _encoded(sight: SightPart, n: int = 40) -> list[Encoded]:
    encoder = encoder_of(sight)
    return [encoder.encode(picture) for picture in PICTURES[:n]]


def test_frames_repeat_bit_for_bit_and_show_what_was_drawn(sight: SightPart) -> None:
    frames, decoder = _encoded(sight), decoder_of(sight)
    assert frames == _encoded(sight)
    keys = [k for k, frame in enumerate(frames) if frame.is_key]
    assert keys == (list(range(40)) if sight.codec == "jpeg" else [0] if sight.intra_refresh else [0, 10, 20, 30])
    for k, frame in enumerate(frames):
        picture = decoder.decode([(0, frame.data)], len(frame.data))
        assert picture is not None
        assert read_stamps(picture) == (Stamp(k, 3 * k),) * 2
        assert decoder.is_sound
        rows = seen_rows(SCENE)
        error = picture[rows].astype(float) - PICTURES[k][rows]
        assert np.mean(error * error) < 255**2 / 10**2.2  # 22 dB
    assert codec_versions(sight.codec)


def test_what_was_lost_is_unsound_until_it_is_made_anew(sight: SightPart) -> None:
    decoder = decoder_of(sight)
    sound = []
    for k, frame in enumerate(_encoded(sight)):
        stretches = [] if k == 4 else [(0, frame.data[:-9])] if k == 25 else [(0, frame.data)]
        decoder.decode(stretches, len(frame.data) if stretches else 0)
        sound.append(decoder.is_sound)
    if sight.codec == "jpeg":
        again = {4: 5, 25: 26}
    elif sight.intra_refresh:
        again = {4: 24, 25: 40}  # 20 whole frames renew all of it
    else:
        again = {4: 10, 25: 30}
    unsound = {k for lost, found in again.items() for k in range(lost, found)}
    assert {k for k in range(40) if not sound[k]} == unsound


def test_hostile_bytes_make_no_picture_or_one_of_the_agreed_size(sight: SightPart) -> None:
    rng, decoder, frames = Random(3), decoder_of(sight), _encoded(sight, 4)
    other = SightPart(width=640, height=480, codec=sight.codec)
    foreign = encoder_of(other).encode(np.zeros((480, 640, 3), dtype=np.uint8)).data
    assert decoder_of(sight).decode([(0, foreign)], len(foreign)) is None
    for _ in range(300):
        data = bytearray(rng.choice(frames).data)
        for _ in range(rng.randrange(40)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        begin = rng.randrange(len(data))
        found = decoder.decode([(begin, bytes(data[begin : begin + rng.randrange(len(data))]))], len(data))
        assert found is None or found.shape == (240, 320, 3)


def _jpeg(width: int, height: int, **options: Any) -> bytes:
    image = pytest.importorskip("PIL.Image", reason="the extra is not installed")
    out = BytesIO()
    image.new("RGB", (width, height), "red").save(out, "JPEG", **options)
    return out.getvalue()


@pytest.mark.parametrize("size", [(1, 1), (801, 603), (1920, 1088), (1088, 1920)])
def test_of_an_external_camera_any_size_is_decoded_up_to_the_largest(size: tuple[int, int]) -> None:
    decoder = decoder_of(SightPart(camera="external"))
    data = _jpeg(*size)
    picture = decoder.decode([(0, data)], len(data))
    assert picture is not None
    assert picture.shape == (size[1], size[0], 3)
    assert read_stamps(picture) == (None, None)


def test_a_bomb_is_no_picture() -> None:
    """Too many pixels, whatever the head says of them, and too many scans of one picture."""
    decoder = decoder_of(SightPart(camera="external"))
    wide = _jpeg(2048, 1088)
    claimed = bytearray(_jpeg(64, 64))
    at = claimed.index(b"\xff\xc0") + 5
    claimed[at : at + 4] = b"\xff\xff\xff\xff"
    one = _jpeg(64, 64, progressive=True)
    scan = one.rindex(b"\xff\xda")
    scans = one[:-2] + one[scan:-2] * 20 + one[-2:]
    for data in (wide, bytes(claimed), scans):
        assert decoder.decode([(0, data)], len(data)) is None
    assert decoder.decode([(0, one)], len(one)) is not None


def test_h264_of_an_external_camera_may_change_its_size() -> None:
    pytest.importorskip("av", reason="the extra is not installed")
    decoder = decoder_of(SightPart(camera="external", codec="h264"))
    for width, height in ((320, 240), (400, 304)):
        encoder = encoder_of(SightPart(codec="h264", width=width, height=height))
        data = encoder.encode(np.full((height, width, 3), 90, dtype=np.uint8)).data
        assert is_key(data)
        picture = decoder.decode([(0, data)], len(data))
        assert picture is not None
        assert picture.shape == (height, width, 3)


def test_units_that_are_cut_are_left_out() -> None:
    stream = b"\0\0\1\x67abc\0\0\1\x65defg\0\0\1\x41hi"
    whole = [b"\0\0\1\x67abc", b"\0\0\1\x65defg", b"\0\0\1\x41hi"]
    assert whole_units(stream, 0, len(stream)) == whole
    assert whole_units(stream[:12], 0, len(stream)) == whole[:1]
    assert whole_units(stream[2:], 2, len(stream)) == whole[1:]
    assert whole_units(b"", 0, 0) == []


@pytest.mark.parametrize(("name", "package"), [("jpeg", "report"), ("h264", "video")])
def test_without_its_package_a_codec_names_the_command(
    name: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = resolve("sight", (f"sight.codec={name}",), None, None)
    monkeypatch.setattr(codec, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=rf"sight: codec: {name} needs the package \w+: .*install.*{package}"):
        check_codec(scenario)
    check_codec(resolve("default", (), None, None))
