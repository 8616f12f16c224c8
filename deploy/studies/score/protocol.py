"""The frozen protocol: its file, and the scenarios that it gives."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import yaml

Track = Literal["open", "jigsaws"]
NAME: Final = "protocol_v1"
_FILE: Final = Path(__file__).with_name("protocol_v1.yaml")
_HASHES: Final = Path(__file__).with_name("protocol_v1.sha256")


@dataclass(frozen=True)
class Setting:
    """One thing that is scored: movements, their instants, noise of what is sent, and the network."""

    name: str
    network: Mapping[str, Any]
    data: str = "direct"
    instants: Literal["restored", "raw"] = "restored"
    noise_mm: float = 0.0

    def scenario(self, seed: int, duration_s: float, source: Mapping[str, Any], names: list[str]) -> dict[str, Any]:
        """Return the raw scenario of a twin on a movement of somebody, with models of other people."""
        return {
            "version": 1,
            "name": NAME,
            "seed": seed,
            "duration_s": duration_s,
            **content()["scenario"],
            "source": dict(source),
            "surgeon": {"sensor_noise_mm": self.noise_mm},
            "network": dict(self.network),
            "identification": {"train": "others", "sensor_noise_mm": self.noise_mm},
            "estimators": names,
            "active_estimator": names[0],
        }


@cache
def content() -> dict[str, Any]:
    """Return the protocol."""
    found: dict[str, Any] = yaml.safe_load(_FILE.read_text(encoding="utf-8"))
    return found


def settings(track: Track, quick: bool) -> list[Setting]:
    """Return what is scored on a track; recordings have no lagging arm."""
    chosen = content()["quick"]["settings"] if quick else content()["settings"]
    every = [Setting(name, **content()["settings"][name]) for name in chosen]
    return [each for each in every if track == "open" or each.data == "direct"]


def hashes() -> dict[str, str]:
    """Return the SHA-256 of each table of the open track, by its file below the population's folder."""
    lines = _HASHES.read_text(encoding="utf-8").splitlines()
    return {name: sha256 for sha256, _, name in (line.partition("  ") for line in lines)}


def digest() -> str:
    """Return the SHA-256 of the protocol, with that of its population."""
    return hashlib.sha256(_FILE.read_bytes() + _HASHES.read_bytes()).hexdigest()
