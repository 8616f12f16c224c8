"""Messages of a key as compressed columns."""

from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from tis.common.clocks import ClockModel
from tis.deploy.logs.blocks import Block
from tis.deploy.logs.read.compact_ints import CompactInts
from tis.deploy.logs.read.payload_instants import NO_INSTANT, payload_instants

Ints = NDArray[np.int64]


class MessageColumns:
    """The messages of one key that a side sent or received, in the order of its log."""

    def __init__(self) -> None:
        self._seq, self._sent, self._log, self._sample, self._command = (CompactInts() for _ in range(5))
        self._fingerprint = CompactInts()

    def append(self, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """Add a message; only the instants of its payload and its fingerprint are kept."""
        row = from_json(payload)
        sample_ns, command_ns = row.get("sample_ns"), row.get("command_sample_ns")
        self._fingerprint.append(_fingerprint(payload))
        self._seq.append(seq)
        self._sent.append(sent_ns)
        self._log.append(log_ns)
        self._sample.append(NO_INSTANT if sample_ns is None else sample_ns)
        self._add_commands(np.array([NO_INSTANT if command_ns is None else command_ns]))

    def extend(self, block: Block, which: Ints) -> None:
        """Add some of a block's messages, by index."""
        sample_ns, command_ns = payload_instants(block, which)
        self._fingerprint.extend(map(_fingerprint, block.payloads(which)))
        self._seq.extend(block.seq[which])
        self._sent.extend(block.publish_ns[which])
        self._log.extend(block.log_ns[which])
        self._sample.extend(sample_ns)
        self._add_commands(command_ns)

    def _add_commands(self, commands_ns: Ints) -> None:
        """Add the command instants of the last messages; a key without any stores none."""
        if len(self._command) or (commands_ns != NO_INSTANT).any():
            # the first command of a key: fill up the messages before it
            n_before = len(self._seq) - len(commands_ns)
            self._command.extend(np.full(n_before - len(self._command), NO_INSTANT))
            self._command.extend(commands_ns)

    def aligned(self, own: ClockModel, sender: ClockModel, surgeon: ClockModel) -> "MessageColumns":
        """Return the messages with every stamp converted from its own clock to the reference clock."""
        found = MessageColumns()
        found._seq, found._fingerprint = self._seq, self._fingerprint
        found._log = _aligned(self._log, own)
        found._sent, found._sample = _aligned(self._sent, sender), _aligned(self._sample, sender)
        found._command = _aligned(self._command, surgeon)
        return found

    def __len__(self) -> int:
        return len(self._seq)

    @property
    def seq(self) -> Ints:
        """Return the sequence numbers, (N,)."""
        return self._seq.values()

    @property
    def fingerprint(self) -> Ints:
        """Return a hash of each payload, (N,): equal payloads have equal ones, others never in practice."""
        return self._fingerprint.values()

    @property
    def sent_ns(self) -> Ints:
        """Return the instants of sending, (N,)."""
        return self._sent.values()

    @property
    def log_ns(self) -> Ints:
        """Return the instants of sending or receiving on this side, (N,)."""
        return self._log.values()

    @property
    def sample_ns(self) -> Ints:
        """Return the sample instants, (N,)."""
        return self._sample.values()

    @property
    def command_sample_ns(self) -> Ints:
        """Return the sample instants of the commands answered, (N,); `NO_INSTANT` for none."""
        if not len(self._command):
            return np.full(len(self), NO_INSTANT, dtype=np.int64)
        return self._command.values()


def _fingerprint(payload: bytes) -> int:
    """Return 63 bits of a cryptographic hash, so that nobody can write a payload for a given one."""
    return int.from_bytes(blake2b(payload, digest_size=8).digest(), "little") >> 1


def _aligned(instants: CompactInts, model: ClockModel) -> CompactInts:
    if model.shared:
        return instants
    ns = instants.values()
    found = CompactInts()
    found.extend(np.where(ns == NO_INSTANT, NO_INSTANT, model.to_reference_ns(ns)))
    return found
