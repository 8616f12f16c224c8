"""Every model of a message or record that the product declares."""

import importlib
from collections.abc import Iterator

from tests.test_source import ROOT, product_files
from tis.common.messages import Message


def every_message() -> list[type[Message]]:
    """Return the models, by name; their modules are found by what they import."""
    for file in product_files():
        if "(Message, frozen=True" in file.read_text(encoding="utf-8"):
            importlib.import_module("tis." + ".".join(file.relative_to(ROOT).with_suffix("").parts))
    return sorted(
        {model for model in _below(Message) if model.__module__.startswith("tis.")}, key=lambda m: m.__name__
    )


def _below(model: type[Message]) -> Iterator[type[Message]]:
    for derived in model.__subclasses__():
        yield derived
        yield from _below(derived)
