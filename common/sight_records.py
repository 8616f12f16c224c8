"""Records of sight: the frames that the camera sends, and what the surgeon's screen makes of each."""

from typing import Annotated, Final, Literal

from msgspec import Meta

from tis.common.messages import Message
from tis.common.topic import Topic

_FRAME: Final = "Number of the frame, from 0."
_PIXEL: Final = "of the {} arm's tool in the picture, in pixels; null: this hand does not move."


class CameraNote(Message, frozen=True):
    """A frame of the camera: when it was captured, what it shows, how it was sent.

    From these the picture can be drawn again (`tis.common.sight.picture`).
    """

    frame: Annotated[int, Meta(description=_FRAME)]
    captured_ns: Annotated[int, Meta(description="Run time at which the frame was captured, in ns.")]
    command: Annotated[
        int,
        Meta(
            description="Number of the newest command that the picture shows, which is that of its sample, from 0; "
            "of two hands the smaller one; -1: none."
        ),
    ]
    left_x: Annotated[int | None, Meta(description=f"Column {_PIXEL.format('left hand')}")]
    left_y: Annotated[int | None, Meta(description=f"Row {_PIXEL.format('left hand')}")]
    right_x: Annotated[int | None, Meta(description=f"Column {_PIXEL.format('right hand')}")]
    right_y: Annotated[int | None, Meta(description=f"Row {_PIXEL.format('right hand')}")]
    is_key: Annotated[bool, Meta(description="true: it can be decoded without the frames before it.")]
    n_bytes: Annotated[int, Meta(description="Size of the encoded frame, in bytes.")]
    n_fragments: Annotated[int, Meta(description="Number of messages that carry it.")]
    first_seq: Annotated[int, Meta(description="Sequence number of the first of these messages.")]
    sent_ns: Annotated[int, Meta(description="Run time at which the last of them was sent, in ns.")]


CAMERA = Topic("/tis/camera", CameraNote, stamps=("captured_ns", "sent_ns"))


class EncodedFrame(Message, frozen=True):
    """A frame as it was sent: the content of a foxglove.CompressedVideo (h264) or CompressedImage (jpeg)."""

    frame: Annotated[int, Meta(description=_FRAME)]
    captured_ns: Annotated[int, Meta(description="Run time at which the frame was captured, in ns.")]
    format: Annotated[
        Literal["jpeg", "h264"],
        Meta(description="jpeg: an image; h264: one access unit in the byte stream format of Annex B."),
    ]
    data: Annotated[str, Meta(description="The encoded frame, base64.")]


PICTURES = Topic("/tis/video", EncodedFrame, stamps=("captured_ns",))
"""Read only where it is asked for by name: it has most of a log's bytes."""

FrameState = Literal["complete", "concealed", "torn", "undecodable", "lost"]
"""What the screen made of a frame.

complete: all of it arrived, and so did what it refers to; concealed: parts of it, or of frames that it refers to, did
not arrive, and the decoder filled the gaps; torn: its stamps contradict each other or the frame's number;
undecodable: the decoder made no picture of what arrived; lost: nothing of it arrived.
"""


class ScreenNote(Message, frozen=True):
    """What the screen made of a frame, in the order of decoding; a frame that nobody sent has no record."""

    frame: Annotated[int, Meta(description=_FRAME)]
    state: Annotated[
        FrameState,
        Meta(
            description="complete: all of it and of what it refers to arrived; concealed: not all, and the decoder "
            "filled the gaps; torn: its stamps contradict each other or its number; undecodable: the decoder made no "
            "picture of it; lost: nothing of it arrived."
        ),
    ]
    top_frame: Annotated[int | None, Meta(description="Frame number read from the upper stamp; null: unreadable.")]
    top_command: Annotated[int | None, Meta(description="Command read from the upper stamp; null: unreadable.")]
    bottom_frame: Annotated[int | None, Meta(description="Frame number read from the lower stamp; null: unreadable.")]
    bottom_command: Annotated[int | None, Meta(description="Command read from the lower stamp; null: unreadable.")]
    first_ns: Annotated[
        int | None, Meta(description="Run time at which its first fragment arrived, in ns; null: none did.")
    ]
    last_ns: Annotated[
        int | None, Meta(description="Run time at which its last fragment arrived, in ns; null: none did.")
    ]
    shown_ns: Annotated[
        int | None,
        Meta(
            description="Run time of the display's refresh that showed it, in ns; null: there was no picture, or a "
            "newer one came before that refresh."
        ),
    ]
    fragments: Annotated[int, Meta(description="Number of its fragments that arrived.")]
    expected: Annotated[int | None, Meta(description="Number of its fragments; null: none arrived that tells it.")]
    missing: Annotated[
        str,
        Meta(description="Numbers of the fragments that did not arrive, from 0, like 0-2,5; of a lost frame empty."),
    ] = ""


SCREEN = Topic("/tis/screen", ScreenNote, stamps=("first_ns", "last_ns", "shown_ns"))

FRAGMENT_COUNTERS: Final = ("duplicated", "reordered", "corrupted", "forged", "late")
"""Counters of the screen, each behind ``video_``: fragments that came again, behind a later one, with a wrong
checksum, of another run or of no frame that there is, and after their frame was decoded."""

CameraRefusal = Literal["undecodable", "other_format", "flooded"]
"""Why a message of an external camera is not used; counters of the camera's log, each behind ``camera_``."""
