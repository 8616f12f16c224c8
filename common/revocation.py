"""The file of revoked certificates: a line for each, NAME or NAME SERIAL, beside the folders of the names."""

import re
from typing import Final, NamedTuple

REVOKED_FILE: Final = "revoked.txt"
MAX_BYTES: Final = 1_000_000
_LINE: Final = re.compile(r"([A-Za-z0-9_][A-Za-z0-9_.-]{0,63})(?: +([0-9a-f]{1,40}))?")
_MAX_FAULTS: Final = 10


class Revoked(NamedTuple):
    """Revoked names, and the serial numbers of those lines that have one; ``faults`` are of lines that are none."""

    names: frozenset[str] = frozenset()
    serials: frozenset[tuple[str, int]] = frozenset()
    faults: tuple[str, ...] = ()

    def covers(self, name: str, serial: int) -> bool:
        """Tell whether a certificate is revoked: by its serial number, or by a line of its name without one."""
        with_serial = {one for one, _ in self.serials}
        return (name, serial) in self.serials or (name in self.names and name not in with_serial)


NONE_REVOKED: Final = Revoked()


def read_revoked(content: bytes) -> Revoked:
    """Return what a file says; each line that can be read counts, whatever the others hold.

    Oracle: lines made of names and numbers, tests/common/test_revocation.
    """
    names, serials, faults = set[str](), set[tuple[str, int]](), list[str]()
    if len(content) > MAX_BYTES:
        faults.append(f"must have at most {MAX_BYTES} bytes; what is beyond is not read")
    for number, line in enumerate(content[:MAX_BYTES].decode("utf-8", "replace").splitlines(), 1):
        text = line.partition("#")[0].strip()
        found = _LINE.fullmatch(text)
        if found is not None:
            names.add(found[1])
            if found[2]:
                serials.add((found[1], int(found[2], 16)))
        elif text and len(faults) < _MAX_FAULTS:
            faults.append(f"line {number} must read NAME, or NAME SERIAL in hex")
    return Revoked(frozenset(names), frozenset(serials), tuple(faults))
