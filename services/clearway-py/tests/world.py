"""A place in shared memory that nobody else uses, and real daemons in it."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import clearway

PACKAGE = Path(__file__).resolve().parent.parent
REPOSITORY = PACKAGE.parent.parent
PATIENCE_S = 120.0
"""Far longer than any of this takes; a hang must not hang the suite."""


def clearwayd() -> str:
    """The daemon that ``CLEARWAYD`` names, or the one that was built last."""
    named = os.environ.get("CLEARWAYD")
    target = Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    built = [target / profile / "clearwayd" for profile in ("debug", "release")]
    found = [named] if named else sorted(filter(Path.is_file, built), key=lambda path: path.stat().st_mtime)
    if not found:
        raise AssertionError("there is no daemon: run cargo build -p clearwayd, or set CLEARWAYD")
    return str(found[-1])


def until(look):
    """Calls ``look`` until it finds something."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        found = look()
        if found:
            return found
        time.sleep(0.002)
    raise AssertionError("nothing came")


class WorldTestCase(unittest.TestCase):
    """Every test has its own world, which has to be empty at the end."""

    _next = itertools.count()

    def setUp(self):
        name = f"py_{os.getpid()}_{next(self._next)}"
        self.prefix = f"cw_{name}_"
        self.root = Path(tempfile.mkdtemp(prefix=f"clearway_{name}_"))
        self.environment = {
            **os.environ,
            "CLEARWAY_IOX2_PREFIX": self.prefix,
            "CLEARWAY_IOX2_ROOT": str(self.root / "iceoryx2"),
            "PYTHONPATH": str(PACKAGE),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        # Clean-ups run last in, first out: processes end before the world is looked at.
        self.addCleanup(self._leave)

    def _leave(self):
        left = [path for path in Path("/dev/shm").iterdir() if path.name.startswith(self.prefix)]
        for path in left:
            path.unlink(missing_ok=True)
        shutil.rmtree(self.root)
        # iceoryx2 keeps one small file for each prefix as long as the machine is up.
        left = [path.name for path in left if path.suffix != ".global_mgmt"]
        self.assertEqual(left, [], "left in shared memory")

    def attach(self, **more) -> clearway.Client:
        location = {"prefix": self.prefix, "root": self.root / "iceoryx2"}
        client = clearway.attach(**{"wait_s": PATIENCE_S, **location, **more})
        self.addCleanup(client.close)
        return client

    def start(self, command, **more) -> subprocess.Popen:
        """A process that does not outlive its test."""
        process = subprocess.Popen(command, env=self.environment, cwd=self.root, text=True, **more)

        def end():
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)
                process.terminate()
            try:
                process.communicate(timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()

        self.addCleanup(end)
        return process

    def python(self, *arguments: str) -> subprocess.Popen:
        return self.start([sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def daemon(self, *arguments: str, period_us: int = 10_000, endless: bool = True) -> subprocess.Popen:
        """The daemon on swap8; endless: until a signal."""
        settings = ["--set", "realtime.policy=off", "--set", f"timing.period_us={period_us}"]
        if endless:
            (self.root / "fleet.toml").write_text('schema = 1\nscenario = "swap8"\n')
            settings += ["--config", "fleet.toml"]
        settings += ["--report", "report.json", *arguments]
        return self.start(
            [clearwayd(), *settings],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def ended(self, process: subprocess.Popen) -> str:
        """What a process said, once it has ended, and ended well."""
        out, err = process.communicate(timeout=PATIENCE_S)
        said = (out or "") + (err or "")
        self.assertEqual(process.returncode, 0, said)
        return said

    def stop(self, daemon: subprocess.Popen) -> dict:
        """Ends an endless daemon; its report."""
        daemon.send_signal(signal.SIGTERM)
        return self.report(daemon)

    def report(self, daemon: subprocess.Popen) -> dict:
        """The report of a daemon that ends."""
        self.ended(daemon)
        return json.loads((self.root / "report.json").read_text())
