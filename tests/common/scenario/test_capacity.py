from typing import Any

import pytest
from pydantic import ValidationError

from tis.common.scenario.network.capacity import Rate


def test_a_bit_rate_is_enough() -> None:
    rate = Rate.model_validate({"kbit_s": 512})
    assert (rate.overhead_bytes, rate.queue.kind, rate.queue.max_packets, rate.queue.max_bytes) == (
        0,
        "tail_drop",
        1000,
        None,
    )


@pytest.mark.parametrize(
    ("field", "part"),
    [
        ("kbit_s", {"kbit_s": 0}),
        ("kbit_s", {"kbit_s": 5e-324}),  # a byte would take longer than there are int64 ns
        ("kbit_s", {"kbit_s": 2e9}),
        ("overhead_bytes", {"kbit_s": 1, "overhead_bytes": -1}),
        ("max_packets", {"kbit_s": 1, "queue": {"kind": "tail_drop", "max_packets": 0}}),
        ("max_bytes", {"kbit_s": 1, "queue": {"kind": "codel", "max_bytes": 0}}),
        ("target_ms", {"kbit_s": 1, "queue": {"kind": "codel", "target_ms": 1e-7}}),
        ("interval_ms", {"kbit_s": 1, "queue": {"kind": "codel", "interval_ms": 1e-7}}),
    ],
)
def test_what_could_not_be_served_is_refused(field: str, part: dict[str, Any]) -> None:
    with pytest.raises(ValidationError) as refused:
        Rate.model_validate(part)
    assert [error["loc"][-1] for error in refused.value.errors()] == [field]
