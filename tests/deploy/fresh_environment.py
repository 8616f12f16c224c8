"""A wheel, a notebook, and the commands of the GitHub Action and of netem's image, in new environments.

`python -m tests.deploy.fresh_environment` needs no container engine and no runner: it reads the commands from their
files, runs them, and prints the size of what they install. It installs from the package index, so no test runs it.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

from tis.common.runtime.ports import free_endpoints

ROOT = Path(__file__).resolve().parents[2]
ACTION = ROOT / "deploy" / "action" / "action.yml"
DOCKERFILE = ROOT / "deploy" / "docker" / "Dockerfile"
_PATH = f"{Path(sys.executable).parent}:/usr/local/bin:/usr/bin:/bin"


def action_steps(**inputs: str) -> list[tuple[str, dict[str, str]]]:
    """Return the script of each step of the Action with its environment, as the runner fills it in."""
    action: dict[str, Any] = yaml.safe_load(ACTION.read_text(encoding="utf-8"))
    given = {name: inputs.get(name, each.get("default", "")) for name, each in action["inputs"].items()}

    def filled(text: str) -> str:
        return re.sub(r"\$\{\{ inputs\.(\w+) \}\}", lambda found: given[found[1]], text)

    return [
        (step["run"], {name: filled(text) for name, text in step.get("env", {}).items()})
        for step in action["runs"]["steps"]
    ]


def run_step(script: str, env: dict[str, str], folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a step as GitHub's runner does."""
    runner = {
        "PATH": _PATH,
        "HOME": str(folder),
        "RUNNER_TEMP": str(folder),
        "GITHUB_ACTION_PATH": str(ACTION.parent),
    }
    words = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script]
    return subprocess.run(words, env=runner | env, cwd=folder, capture_output=True, text=True, check=False)


def stages() -> dict[str, list[str]]:
    """Return the instructions of each stage of the Dockerfile, continued lines as one; the last one has no name."""
    found: dict[str, list[str]] = {}
    stage = ""
    for line in DOCKERFILE.read_text(encoding="utf-8").replace("\\\n", "").splitlines():
        if head := re.match(r"FROM \S+(?: AS (\S+))?", line):
            stage = head[1] or ""
        elif line and not line.startswith("#"):
            found.setdefault(stage, []).append(line)
    return found


def _megabytes(folder: Path) -> str:
    n_bytes = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file() and not file.is_symlink())
    return f"{n_bytes // 10**6} MB"


def _installed(folder: Path, extras: str = "", *more: str) -> tuple[Path, Path]:
    """Build a wheel and install it in an environment that has nothing else; return the wheel and its programs."""
    dist, programs = folder / "dist", folder / "venv" / "bin"
    pip = [sys.executable, "-m", "pip", "--quiet"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", dist, ROOT], check=True)
    (wheel,) = dist.iterdir()
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", programs.parent], check=True)
    subprocess.run([*pip, "--python", programs / "python", "install", f"{wheel}{extras}", *more], check=True)
    return wheel, programs


def _run_notebook(folder: Path) -> None:
    """Execute the manual's comparison in Jupyter, from a wheel, in a folder that holds nothing else."""
    notebook = "compare_in_python.ipynb"
    _, programs = _installed(folder, "[parquet,report]", "nbconvert", "ipykernel")
    (folder / "empty").mkdir()
    shutil.copy(ROOT / "docs" / notebook, folder / "empty")
    words: list[str | Path] = [
        programs / "python",
        "-m",
        "nbconvert",
        "--to",
        "notebook",
        "--execute",
        "--output",
        "done",
        notebook,
    ]
    env = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    subprocess.run(words, cwd=folder / "empty", env={**env, "PATH": f"{programs}:{_PATH}"}, check=True)
    cells = json.loads((folder / "empty" / "done.ipynb").read_text(encoding="utf-8"))["cells"]
    printed = ["".join(out["text"]) for cell in cells for out in cell.get("outputs", ()) if "text" in out]
    sys.stdout.write(f"{notebook} from a wheel:\n{''.join(printed)}\n")


def _run_wheel(folder: Path) -> None:
    """Install a wheel beside nothing, and start netem from it; by uv's `uvx`, too, where there is one."""
    wheel, programs = _installed(folder)
    ways: list[list[Any]] = [[programs / "tis"]]
    ways += [] if shutil.which("uvx") is None else [["uvx", "--from", wheel, "tis"]]
    for way in ways:
        west, east = free_endpoints()
        begin_s = time.monotonic()
        words = ["netem", "--west", west, "--east", east, "--profile", "wifi_bad", "--duration-s", "0"]
        subprocess.run([*way, *words], cwd=folder, check=True)
        sys.stdout.write(f"{Path(way[0]).name}: began and ended in {time.monotonic() - begin_s:.1f} s\n")
    sys.stdout.write(
        f"a wheel of {wheel.stat().st_size / 1e6:.1f} MB; its environment: {_megabytes(programs.parent)}\n"
    )


def _run_action(folder: Path) -> None:
    folder.mkdir()
    for script, env in action_steps(run="tis net show -e $TIS_WEST", profile="wifi_bad"):
        done = run_step(script, env, folder)
        assert done.returncode == 0, done.stdout + done.stderr
    sys.stdout.write(f"{done.stdout}\nthe Action's environment: {_megabytes(folder / 'tis')}\n")


def _run_image(folder: Path) -> None:
    shutil.copytree(ROOT, folder / "source", symlinks=True, ignore=shutil.ignore_patterns(".*", "runs", "_build"))
    programs = folder / "opt" / "tis"
    for line in stages()["build-netem"]:
        kind, _, command = line.partition(" ")
        assert kind == "RUN", line
        command = command.replace("/opt/tis", str(programs))
        env = {**os.environ, "PATH": _PATH}
        subprocess.run(["bash", "-ec", command], cwd=folder / "source", env=env, check=True)
    (entry,) = (line for line in stages()["netem"] if line.startswith("ENTRYPOINT"))
    program, *words = yaml.safe_load(entry.removeprefix("ENTRYPOINT "))
    west, east = free_endpoints()
    words += ["--west", west, "--east", east, "--profile", "wifi_bad", "--duration-s", "1", "--summarize"]
    subprocess.run([programs / "bin" / program, *words], cwd=folder, check=True)
    sys.stdout.write(f"netem's image, beside Python's: {_megabytes(programs)}\n")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        _run_wheel(Path(name) / "wheel")
        _run_notebook(Path(name) / "notebook")
        _run_action(Path(name) / "action")
        _run_image(Path(name) / "image")
