"""Extras that are not installed, and the command that installs one into this environment, however it was made."""

import json
import re
import shlex
import sys
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlparse

PACKAGE: Final = "tis-testbed"


@dataclass(frozen=True)
class Extra:
    """An extra of the package, or ``packages`` that none has; as text it is the command that installs it."""

    name: str = ""
    packages: tuple[str, ...] = ()

    def __str__(self) -> str:
        return install_command(self, Path(sys.prefix))


GET_REPORT: Final = Extra("report")
GET_PARQUET: Final = Extra("parquet")
GET_ROSBAG: Final = Extra("rosbag")
GET_PCAP: Final = Extra("pcap")
GET_HOSTS: Final = Extra("hosts")
GET_CLUSTER: Final = Extra("cluster")
GET_DEVICE: Final = Extra("device")
GET_LEARNED: Final = Extra("learned")
GET_SIM: Final = Extra("sim")
GET_VIDEO: Final = Extra("video")
GET_DYNAMICS: Final = Extra("dynamics")
GET_PANDAS: Final = Extra(packages=("pandas",))


def install_command(extra: Extra, prefix: Path) -> str:
    """Return the command that installs an extra into the environment at ``prefix``.

    In a clone the extra is named. An installed wheel may lie nowhere any more: there the packages of the extra are.
    pipx has commands of its own; an environment made by uv has no pip.
    """
    packages, in_clone = _wanted(extra)
    if (prefix / "pipx_metadata.json").is_file():
        pipx = ["pipx", "runpip", PACKAGE, "install"] if in_clone else ["pipx", "inject", PACKAGE]
        return shlex.join([*pipx, *packages])
    if _is_of_uv(prefix):
        return shlex.join(["uv", "pip", "install", "--python", str(prefix), *packages])
    if find_spec("pip") is None:
        return shlex.join(["pip", "--python", str(prefix), "install", *packages])
    return shlex.join([sys.executable, "-m", "pip", "install", *packages])


def _wanted(extra: Extra) -> tuple[list[str], bool]:
    """Return what is to be installed, and whether it is the clone with the extra."""
    installed = _installed()
    if extra.packages or installed is None:
        return [*extra.packages] or [f"{PACKAGE}[{extra.name}]"], False
    clone = _clone(installed)
    return (packages_of(installed, extra.name), False) if clone is None else (["-e", f"{clone}[{extra.name}]"], True)


def packages_of(installed: Distribution, extra: str) -> list[str]:
    """Return the requirements of an extra, as its metadata states them."""
    of_extra = re.compile(rf"""extra\s*==\s*["']{re.escape(extra)}["']""")
    split = (text.partition(";") for text in installed.requires or ())
    return [package.strip() for package, _, marker in split if of_extra.search(marker)]


def _installed() -> Distribution | None:
    try:
        return distribution(PACKAGE)
    except PackageNotFoundError:
        return None


def _clone(installed: Distribution) -> str | None:
    """Return the folder of the clone from which the package is imported; None for an installed wheel."""
    try:
        origin = json.loads(installed.read_text("direct_url.json") or "{}")
    except ValueError:
        return None
    is_editable = origin.get("dir_info", {}).get("editable", False)
    return unquote(urlparse(origin["url"]).path) if is_editable else None


def _is_of_uv(prefix: Path) -> bool:
    """Tell whether uv made an environment, of a tool or of a project."""
    if (prefix / "uv-receipt.toml").is_file():
        return True
    try:
        return re.search(r"^uv\s*=", (prefix / "pyvenv.cfg").read_text(encoding="utf-8"), re.MULTILINE) is not None
    except OSError:
        return False
