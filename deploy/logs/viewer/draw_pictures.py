"""The camera's picture for viewers: each frame as it was sent, at its capture."""

from base64 import b64decode
from collections.abc import Iterator

from tis.deploy.logs.payloads import json_row
from tis.deploy.logs.viewer import foxglove
from tis.deploy.logs.viewer.drawn import CAMERA_VIDEO, Drawn, Records


class PictureStream:
    """Draws the frames of a camera."""

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield each frame as an image or as video."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            row = json_row(payload)
            kind = "image" if row["format"] == "jpeg" else "video"
            yield Drawn(
                CAMERA_VIDEO, kind, at_ns, foxglove.picture(kind, at_ns, row["format"], b64decode(row["data"]))
            )
