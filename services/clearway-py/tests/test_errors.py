"""Mistakes and missing things are told apart."""

import os
import subprocess
import sys
import time
import unittest

import clearway
from clearway import wheel
from clearway.layout import Record, StateHeader, _laid_out
from clearway.transport import Attachment, Transport
from clearway.wheel import iox2

from .world import PACKAGE, WorldTestCase


@_laid_out
class RobotState(Record):
    """A state of another version."""

    id: clearway.layout.U64


class Errors(WorldTestCase):
    def test_without_a_daemon(self):
        with self.assertRaisesRegex(clearway.NoDaemonError, "clearway/nobody/v1/state.*clearwayd"):
            self.attach(fleet="nobody", wait_s=0.0)
        before = time.monotonic()
        with self.assertRaises(clearway.NoDaemonError):
            self.attach(wait_s=0.2)
        self.assertGreaterEqual(time.monotonic(), before + 0.2)

    def test_names_that_cannot_be(self):
        for name in ("", "a/b", "ä", "x" * 65, "two words", "x\n"):
            with self.assertRaisesRegex(clearway.FleetNameError, "letters"):
                clearway.attach(name)
        for prefix in ("a/b", "x" * 300):
            with self.assertRaisesRegex(clearway.LocationError, "CLEARWAY_IOX2_PREFIX"):
                clearway.attach(prefix=prefix, root=self.root)
        with self.assertRaisesRegex(clearway.LocationError, "root"):
            clearway.attach(prefix=self.prefix, root="/" + "x" * 3000)

    def test_a_place_that_cannot_be_joined(self):
        with self.assertRaisesRegex(clearway.AttachError, "/proc/nowhere") as failed:
            clearway.attach(prefix=self.prefix, root="/proc/nowhere/")
        self.assertIsInstance(failed.exception, OSError)

    def test_the_environment_says_where(self):
        self.daemon()
        self.attach()
        code = "import clearway; print(clearway.attach().states.wait(60).header.period_ns)"
        self.assertEqual(self.ended(self.python("-c", code)).strip(), "10000000")

    def test_another_version(self):
        node = Attachment(Transport("default", self.prefix, self.root / "iceoryx2"))
        name = iox2.ServiceName.new("clearway/default/v1/state")
        builder = node._node.service_builder(name).publish_subscribe(iox2.Slice[RobotState])
        service = builder.user_header(StateHeader).create()
        with self.assertRaisesRegex(clearway.SchemaError, "another schema than v1"):
            self.attach(wait_s=0.0)
        del service

    def test_no_place_for_another_reader(self):
        self.daemon("--set", "timing.workers=1", "--set", "timing.period_us=50_000")
        clients = []
        with self.assertRaisesRegex(clearway.ChannelError, "max_readers"):
            for _ in range(100):
                clients.append(self.attach())
                clients[-1].states  # noqa: B018
        self.assertGreater(len(clients), 4)

    @unittest.skipUnless(os.geteuid() == 0, "only root can become somebody else")
    def test_another_user(self):
        self.daemon()
        self.attach().states.wait(60)
        os.chmod(self.root, 0o755)
        code = (
            "import os, clearway\n"
            "os.setgid(65534); os.setuid(65534)\n"
            "try: clearway.attach()\n"
            "except clearway.AttachError as error: print(error)"
        )
        self.assertIn("belong to user root", self.ended(self.python("-c", code)))


class Wheel(unittest.TestCase):
    def test_a_missing_wheel_is_named(self):
        code = (
            f"import sys; sys.path[:0] = [{str(PACKAGE)!r}]; sys.modules['iceoryx2'] = None; import clearway"
        )
        run = subprocess.run([sys.executable, "-B", "-c", code], capture_output=True, text=True, check=False)
        self.assertIn("pip install iceoryx2==0.10.0", run.stderr)
        self.assertIn("ModuleNotFoundError", run.stderr.splitlines()[-1])

    def test_another_wheel_is_refused(self):
        with self.assertRaisesRegex(ImportError, "iceoryx2 0.9.1 is installed"):
            wheel.check("0.9.1")
        wheel.check(wheel.VERSION)
