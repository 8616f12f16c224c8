"""Model files with weights: safetensors, whose metadata holds the JSON text of the models.

Nothing in such a file is code (no pickle). The text names every array of weights by the tensor that holds it, so that
two hands that share a learned model store it once.
"""

import json
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, numpy

from tis.common.errors import DataError, Fault

Tensors = Mapping[str, NDArray[np.float32]]

_TEXT: Final = "tis"
"""Key of the models' text in the file's metadata."""
_METADATA: Final = "__metadata__"
_LENGTH_BYTES: Final = 8


def is_tensor_file(data: bytes) -> bool:
    """Tell whether a model file's content is not the JSON text of a file without weights."""
    return not data[:64].lstrip().startswith(b"{")


def dump_tensors(text: str, tensors: Tensors) -> bytes:
    """Return the file of a text and its tensors."""
    return bytes(numpy.save({name: np.ascontiguousarray(each) for name, each in tensors.items()}, {_TEXT: text}))


def parse_tensors(data: bytes, where: str) -> tuple[str, Tensors]:
    """Return text and tensors of a file; raises `DataError` for one that is truncated, or not of tis."""
    try:
        tensors = numpy.load(data)
    except SafetensorError as error:
        rule = f"must be JSON or safetensors, and whole: {error}"
        raise DataError(Fault(where, "", rule)) from None
    # The library has checked the header, but returns its metadata for files on disk only.
    n_bytes = int.from_bytes(data[:_LENGTH_BYTES], "little")
    header = json.loads(data[_LENGTH_BYTES : _LENGTH_BYTES + n_bytes])
    text = header.get(_METADATA, {}).get(_TEXT)
    if text is None:
        raise DataError(Fault(where, f"{_METADATA}.{_TEXT}", "is missing: `tis identify` did not write this file"))
    wrong = {name: str(each.dtype) for name, each in tensors.items() if each.dtype != np.float32}
    if wrong:
        raise DataError([Fault(where, name, "must be float32", found) for name, found in wrong.items()])
    return text, tensors
