"""Encoders and decoders of the picture: jpeg by Pillow, h264 by PyAV, on one thread each, so that bytes repeat.

A decoder gets what arrived of a frame, and fills the gaps as its library does. Whatever it gets, it returns a picture
of a size that the scenario allows, or None. Both libraries are imported where they are used: a run without sight
needs none.
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from importlib.util import find_spec
from math import inf
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from tis.common.errors import Fault, InputError
from tis.common.extras import GET_REPORT, GET_VIDEO
from tis.common.scenario import Scenario
from tis.common.scenario.sight import SightPart
from tis.common.sight.stamp import Picture

Stretches = Sequence[tuple[int, bytes]]
"""What arrived of a frame: stretches without a gap, each with its first byte's number."""

_PACKAGES: Final = {"jpeg": ("PIL", GET_REPORT), "h264": ("av", GET_VIDEO)}
_END_OF_IMAGE: Final = b"\xff\xd9"
_START_CODE: Final = b"\x00\x00\x01"
_SCAN: Final = b"\xff\xda"
_MAX_SCANS: Final = 20
"""Scans of a JPEG: each takes the time of a whole picture, and a progressive one has some ten."""
_LEAST_SLICE: Final = 200
_KEY: Final = 5
"""Type of the units of a key frame."""
_MAX_DECODED: Final = 2
"""Multiple of the agreed number of pixels beyond which h264 of strangers is not decoded."""


class Encoded(NamedTuple):
    """An encoded frame; ``is_key``: it is decoded without earlier ones."""

    data: bytes
    is_key: bool


class Encoder(Protocol):
    """Encodes the frames of one run in their order."""

    def encode(self, picture: Picture) -> Encoded:
        """Return the next frame."""


class Decoder(Protocol):
    """Decodes the frames of one run in their order, lost ones among them."""

    @property
    def is_sound(self) -> bool:
        """Tell whether the last frame arrived whole, and all that it refers to."""

    def decode(self, stretches: Stretches, n_bytes: int) -> Picture | None:
        """Return the picture made of what arrived of a frame of ``n_bytes``; None for none."""


def check_codec(scenario: Scenario) -> None:
    """Raise `InputError` where this installation cannot encode or decode the scenario's video."""
    if scenario.sight is None:
        return
    package, extra = _PACKAGES[scenario.sight.codec]
    if find_spec(package) is None:
        raise InputError(Fault("sight", "codec", f"{scenario.sight.codec} needs the package {package}: {extra}"))


def codec_versions(codec: str) -> Mapping[str, str]:
    """Return the versions of the libraries behind a codec: another one may make other bytes of the same picture."""
    if codec == "jpeg":
        import PIL
        from PIL import features

        return {"pillow": PIL.__version__, "jpeg": str(features.version("libjpeg_turbo") or features.version("jpg"))}
    import av

    libraries = {name: ".".join(map(str, one)) for name, one in av.library_versions.items()}
    return {"av": av.__version__, **{name: libraries[name] for name in ("libavcodec", "libswscale")}}


def _load_pillow() -> None:
    """Load Pillow and its format now: it takes longer than a frame."""
    from PIL import Image

    Image.preinit()


def encoder_of(sight: SightPart) -> Encoder:
    """Return the encoder of a scenario's video."""
    return JpegEncoder(sight.quality) if sight.codec == "jpeg" else H264Encoder(sight)


def decoder_of(sight: SightPart) -> Decoder:
    """Return the decoder of a scenario's video."""
    if sight.codec == "jpeg":
        return JpegDecoder(sight)
    return H264Decoder(sight, 2 * sight.key_every if sight.intra_refresh else None)


@dataclass
class JpegEncoder:
    """Each frame by itself, with restart markers: damage ends with its row of blocks."""

    quality: int

    def __post_init__(self) -> None:
        _load_pillow()

    def encode(self, picture: Picture) -> Encoded:
        """Return the next frame."""
        from PIL import Image

        out = io.BytesIO()
        Image.fromarray(picture).save(out, "JPEG", quality=self.quality, restart_marker_rows=1)
        return Encoded(out.getvalue(), is_key=True)


@dataclass
class JpegDecoder:
    """Puts zeros in the place of what did not arrive; libjpeg goes on at the next restart marker."""

    sight: SightPart
    is_sound: bool = False

    def __post_init__(self) -> None:
        _load_pillow()

    def decode(self, stretches: Stretches, n_bytes: int) -> Picture | None:
        """Return the picture made of what arrived; None where its head is missing, or it is none of ours."""
        from PIL import Image

        self.is_sound = _are_whole(stretches, n_bytes)
        if not stretches:
            return None
        data = bytearray(n_bytes)
        for begin, content in stretches:
            data[begin : begin + len(content)] = content
        if not data.endswith(_END_OF_IMAGE):
            data[-2:] = _END_OF_IMAGE
        if data.count(_SCAN) > _MAX_SCANS:
            return None
        try:
            with Image.open(io.BytesIO(data), formats=("JPEG",)) as image:
                if not self.sight.is_of_size(*image.size):
                    return None
                return np.array(image.convert("RGB"))
        except Exception:  # what arrives is hostile, and Pillow states no list of what it raises
            return None


@dataclass
class H264Encoder:
    """x264 without frames that refer to later ones, on one thread; slices of about a fragment's size."""

    sight: SightPart
    _context: Any = field(init=False, repr=False)
    _n_frames: int = 0

    def __post_init__(self) -> None:
        import av

        sight = self.sight
        kbit_s = round(sight.bit_rate_kbit_s)
        context = av.CodecContext.create("libx264", "w")
        context.width, context.height, context.pix_fmt = sight.width, sight.height, "yuv420p"
        context.time_base, context.framerate = Fraction(1, sight.fps), Fraction(sight.fps, 1)
        context.thread_count = 1
        # no frame takes longer than its share of the bit rate, but for key frames, which may take two
        x264 = {
            "threads": 1,
            "bframes": 0,
            "keyint": sight.key_every,
            "min-keyint": sight.key_every,
            "scenecut": 0,
            "intra-refresh": int(sight.intra_refresh),
            "bitrate": kbit_s,
            "vbv-maxrate": kbit_s,
            "vbv-bufsize": max(1, kbit_s // sight.fps),
            "slice-max-size": max(sight.fragment_bytes, _LEAST_SLICE),
            "repeat-headers": 1,
            "annexb": 1,
        }
        params = ":".join(f"{name}={value}" for name, value in x264.items())
        context.options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": params}
        self._context = context

    def encode(self, picture: Picture) -> Encoded:
        """Return the next frame, one access unit in the byte stream format."""
        import av

        frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(format="yuv420p")
        frame.pts, frame.time_base = self._n_frames, Fraction(1, self.sight.fps)
        self._n_frames += 1
        packets = self._context.encode(frame)
        is_key = any(packet.is_keyframe for packet in packets)  # where a cycle of refreshes begins, too
        return Encoded(b"".join(map(bytes, packets)), is_key and (frame.pts == 0 or not self.sight.intra_refresh))


@dataclass
class H264Decoder:
    """Gives the decoder the units that arrived whole; it repeats what it has in the place of others."""

    sight: SightPart
    refreshed_in: int | None = None
    """Frames that renew the whole picture, whenever they begin; None: only a key frame does."""
    is_sound: bool = False
    _unsound_for: float = inf
    _context: Any = field(init=False, repr=False)

    def __post_init__(self) -> None:
        import av

        context = av.CodecContext.create("h264", "r")
        context.thread_count = 1
        context.options = {"flags": "low_delay", "max_pixels": str(_MAX_DECODED * self.sight.max_pixels)}
        self._context = context

    def decode(self, stretches: Stretches, n_bytes: int) -> Picture | None:
        """Return the picture made of the units that arrived whole; None for none, or for one of another size."""
        import av

        self._note(stretches, n_bytes)
        data = b"".join(unit for begin, content in stretches for unit in whole_units(content, begin, n_bytes))
        if not data:
            return None
        try:
            frames = self._context.decode(av.Packet(data))
            if not frames or not self.sight.is_of_size(frames[-1].width, frames[-1].height):
                return None
            return np.asarray(frames[-1].to_ndarray(format="rgb24"))
        except (av.FFmpegError, ValueError, MemoryError):
            return None

    def _note(self, stretches: Stretches, n_bytes: int) -> None:
        """Note whether what this frame shows is sound."""
        if not _are_whole(stretches, n_bytes):
            self._unsound_for = inf if self.refreshed_in is None else self.refreshed_in
        elif is_key(stretches[0][1]):
            self._unsound_for = 0
        elif self._unsound_for:
            self._unsound_for -= 1
        self.is_sound = self._unsound_for == 0


def is_key(data: bytes) -> bool:
    """Tell whether a frame of h264 is a key frame."""
    return any(_kind(unit) == _KEY for unit in whole_units(data, 0, len(data)))


def _are_whole(stretches: Stretches, n_bytes: int) -> bool:
    return len(stretches) == 1 and len(stretches[0][1]) == n_bytes


def _kind(unit: bytes) -> int:
    """Return the type of a unit, which its first byte has in its lower bits."""
    return unit[len(_START_CODE)] & 0x1F if len(unit) > len(_START_CODE) else 0


def whole_units(content: bytes, begin: int, n_bytes: int) -> list[bytes]:
    """Return the units of h264's byte stream, start codes included, that lie whole in a stretch of a frame.

    ``begin`` is the number of its first byte, ``n_bytes`` the frame's size: only the frame's end ends a unit without
    a start code behind it.
    """
    starts = []
    at = content.find(_START_CODE)
    while at >= 0:
        starts.append(at)
        at = content.find(_START_CODE, at + len(_START_CODE))
    ends = starts[1:] + ([len(content)] if begin + len(content) == n_bytes else [])
    return [content[one:other] for one, other in zip(starts, ends, strict=False)]
