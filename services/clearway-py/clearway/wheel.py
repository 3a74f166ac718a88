"""The iceoryx2 wheel, in the one version that the daemon speaks."""

from __future__ import annotations

import importlib.metadata

VERSION = "0.10.0"
"""Processes with another version of iceoryx2 do not see the daemon's channels."""

try:
    import iceoryx2 as iox2
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"clearway needs the package iceoryx2 {VERSION}: pip install iceoryx2=={VERSION}", name=error.name
    ) from error


def check(installed: str) -> None:
    """Raises ``ImportError`` for another version than the daemon's."""
    if installed != VERSION:
        raise ImportError(
            f"iceoryx2 {installed} is installed and the daemon speaks {VERSION}: "
            f"pip install iceoryx2=={VERSION}",
            name="iceoryx2",
        )


check(importlib.metadata.version("iceoryx2"))

__all__ = ["VERSION", "check", "iox2"]
