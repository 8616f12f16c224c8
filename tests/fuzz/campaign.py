"""Coverage-guided campaign on one decoder, until an error that it does not document.

``python -m tests.fuzz.campaign DECODER [libFuzzer options]``, with atheris installed (it is no dependency); without a
decoder it lists them.
"""

import random
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import atheris

with atheris.instrument_imports(include=["tis"]):
    from tests.fuzz.decoders import DECODERS, decode
from tests.fuzz.mutations import mutated


def _mutate(data: bytes, max_size: int, seed: int) -> bytes:
    """Return a mutation for libFuzzer: its own, or one that knows about texts and lengths."""
    if seed % 2:
        return bytes(atheris.Mutate(data, max_size))
    return mutated(data, random.Random(seed))[:max_size]


def main() -> None:
    """Run the campaign of the decoder that the first argument names."""
    if len(sys.argv) < 2 or sys.argv[1] not in DECODERS:
        print("\n".join(DECODERS))  # noqa: T201
        return
    name = sys.argv.pop(1)
    with TemporaryDirectory() as corpus:
        for k, sample in enumerate(DECODERS[name].samples):
            Path(corpus, str(k)).write_bytes(sample)
        largest = max(map(len, DECODERS[name].samples))
        options = [sys.argv[0], corpus, f"-max_len={2 * largest + 200}", "-timeout=10", "-rss_limit_mb=500"]
        atheris.Setup([*options, *sys.argv[1:]], lambda data: decode(name, data), custom_mutator=_mutate)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
