"""Results of cells without the processor time of the steps, which differs from run to run."""

import json
from collections.abc import Mapping
from typing import Any


def untimed(cells: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of the cells' results by digest, without times."""
    results: dict[str, Any] = json.loads(json.dumps(cells))
    for result in results.values():
        for hand in result["hands"].values():
            for entry in hand["estimators"].values():
                entry.pop("step_ns", None)
            for entry in hand["orientation"].values():
                entry.pop("step_ns", None)
    return results
