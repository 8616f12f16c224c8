"""Files of any size, read up to a limit."""

from pathlib import Path

import pytest

from tis.common.errors import InputError
from tis.common.runtime.scenario_files import read_limited, read_scenario


def test_a_file_up_to_the_limit_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    assert read_limited(tmp_path / "a", 3) == b"abc"
    with pytest.raises(OSError, match="it has more than 2 bytes"):
        read_limited(tmp_path / "a", 2)


def test_an_endless_device_is_refused() -> None:
    with pytest.raises(InputError, match="/dev/zero: cannot be read: it has more than 4000000 bytes"):
        read_scenario(Path("/dev/zero"))
