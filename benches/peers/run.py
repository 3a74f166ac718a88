#!/usr/bin/env python3
"""Clearway and its peers on the same scenarios, in one run, under one evaluator.

Needs Python 3.11, Rust for building `clearway`, and for the first run the Python package index: the
pinned packages of `requirements.txt` go into a virtual environment in the user's cache.
"""

import sys

if sys.version_info < (3, 11):  # noqa: UP036
    sys.exit("the peers need Python 3.11 or newer: run python3.11 benches/peers/run.py")

import hashlib
import os
import subprocess
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE))

from closed_loop.arguments import parser  # noqa: E402
from closed_loop.clearway import Clearway, ClearwayError  # noqa: E402


class EnvironmentProblemError(Exception):
    """Something outside has to be installed or changed first."""


def default_venv(requirements: Path) -> Path:
    """A place in the user's cache that changes with Python's version and the pinned packages."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    tag = hashlib.sha256(requirements.read_bytes()).hexdigest()[:8]
    return cache / "clearway" / f"peers-{sys.version_info.major}.{sys.version_info.minor}-{tag}"


def provide_venv(folder: Path, requirements: Path) -> Path:
    """The Python of the virtual environment in `folder`, which is made if it is not complete."""
    python, complete = folder / "bin" / "python", folder / ".complete"
    if complete.is_file():
        return python
    print(f"installing the peers into {folder}", file=sys.stderr)
    venv.create(folder, with_pip=True, clear=folder.is_dir() and (folder / "pyvenv.cfg").is_file())
    # No dependencies: pyrvo names a simulator that it works without.
    command = [str(python), "-m", "pip", "install", "--quiet", "--no-deps", "-r", str(requirements)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise EnvironmentProblemError(
            f"pip could not install {requirements}:\n{done.stderr.strip()}\n"
            "Check the network and the package index, or install the packages yourself and name the "
            "environment with --venv; --self-check needs none of them."
        )
    complete.touch()
    return python


def provide_clearway(binary: Path | None) -> Clearway:
    """The program that was named, or the one of this source tree, built if need be."""
    if binary is not None:
        if not binary.is_file():
            raise EnvironmentProblemError(f"{binary} is not there; leave out --clearway to build it")
        return Clearway(binary.resolve())
    command = ["cargo", "build", "--release", "--locked", "--package", "clearway-cli"]
    try:
        done = subprocess.run(command, cwd=ROOT, check=False)
    except OSError as error:
        raise EnvironmentProblemError(
            "cargo is not there: install Rust 1.89 or newer with rustup, or name a program with --clearway"
        ) from error
    if done.returncode != 0:
        raise EnvironmentProblemError("clearway could not be built")
    target = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target")
    return Clearway((ROOT / target / "release" / "clearway").resolve())


def main() -> int:
    """Sees to the environment, then does what was asked."""
    args = parser().parse_args()
    requirements = HERE / "requirements.txt"
    if not args.self_check:
        folder = (args.venv or default_venv(requirements)).resolve()
        if Path(sys.prefix).resolve() != folder:
            python = (
                folder / "bin" / "python"
                if args.venv and (folder / "pyvenv.cfg").is_file()
                else provide_venv(folder, requirements)
            )
            # One core for every peer: no hidden threads.
            environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
            os.execve(python, [str(python), str(HERE / "run.py"), *sys.argv[1:]], environment)
    clearway = provide_clearway(args.clearway)
    from closed_loop import main as work

    return work.self_check(clearway) if args.self_check else work.measure(args, clearway)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
    except (EnvironmentProblemError, ClearwayError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except ModuleNotFoundError as error:
        print(f"{error}: install {HERE / 'requirements.txt'} with pip --no-deps", file=sys.stderr)
        sys.exit(2)
