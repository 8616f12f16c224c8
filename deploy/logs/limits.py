"""Limits of reading a log: a hostile file is refused before it takes memory or time.

All are far beyond the logs of the testbed: an hour at 1 kHz takes some 2 GB and 60 million messages, in chunks of
128 KiB to 1 MiB with up to 5000 messages, and its records are compressed to a tenth to a third.
"""

from typing import Final

MAX_CHUNK_BYTES: Final = 64 << 20
"""Size of a decompressed chunk; recorders of other programs write chunks of 1 to 4 MiB."""

MAX_CHUNK_RECORDS: Final = 1 << 18
"""Records of a chunk; a chunk of 4 MiB with messages of no content holds half as many."""

MAX_EXPANSION: Final = 100
FREE_BYTES: Final = 128 << 20
"""Decompressed bytes of a file: so many for each byte of the file, beyond a first amount that is free."""

FREE_RECORDS: Final = 1 << 19
"""Records of a file: one for each byte of the file, beyond the first ones; a compressed message takes 20 bytes."""

MAX_READ_TIMES: Final = 8
FREE_READ_BYTES: Final = 64 << 20
"""Bytes read from a file: each byte so often, as the search behind damage reads bytes again."""

MAX_RECORD_BYTES: Final = 300_000_000
"""Size of a record on disk; the largest are attached traces, of up to 256 MB."""

MAX_METADATA_BYTES: Final = 1 << 20
"""Size of a metadata record; the list of 40 000 gaps of a recovered log fits."""

MAX_CHANNELS: Final = 4096
MAX_SCHEMAS: Final = 4096
MAX_ATTACHMENTS: Final = 1000
MAX_METADATA: Final = 1000
"""Numbers of them in a file; a run has a channel per topic, some thirty in all."""

MAX_JSON_BYTES: Final = 4 << 20
"""JSON decoded at a time, and size of a record's payload; a batch of 20 000 packets takes 1.5 MB.

As Python objects JSON takes up to 25 times its size.
"""

MAX_NUMBER: Final = 1 << 62
"""Integers and instants of a log, either way: 146 years in ns. Differences of two fit 64 bits."""

MAX_WORD_CHARS: Final = 256
MAX_WORDS: Final = (1 << 15) - 1
"""Length and number of the texts in one field of frequent records: of names and keys, which repeat.

A column of texts takes as much for each of its rows as for the longest.
"""
