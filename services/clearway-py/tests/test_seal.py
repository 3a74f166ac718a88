"""Samples that are not what their writer sealed, by hand and in a daemon's shared memory."""

import ctypes
import unittest
from types import SimpleNamespace

import numpy as np

from clearway import StateFlags, seal
from clearway.layout import CommandHeader, ObservationHeader, RobotCommand, RobotObservation

from .world import PATIENCE_S, WorldTestCase, until


class Sealing(unittest.TestCase):
    def test_the_example_of_the_documentation(self):
        header = ObservationHeader(epoch=1, sequence=2, stamp_ns=3)
        record = RobotObservation(id=7, x_m=1.5, y_m=-2.0, theta_rad=0.25)
        seal.put(seal.seed("clearway/default/v1/observation"), header, 1, bytes(record))
        self.assertEqual((header.records, header.checksum), (1, 0x32E41E2E))

    def test_every_flipped_bit_is_found(self):
        seed = seal.seed("clearway/default/v1/command")
        records = np.zeros(8, RobotCommand.dtype())
        records["id"], records["v_mps"], records["omega_radps"] = range(8), 1.25, -0.5
        header = CommandHeader(epoch=7, tick=8, stamp_ns=9, valid_from_ns=10, valid_until_ns=11)
        seal.put(seed, header, len(records), records.tobytes())
        size = RobotCommand.dtype().itemsize
        memory = ctypes.create_string_buffer(records.tobytes(), records.nbytes)
        number = SimpleNamespace(number_of_elements=len(records))
        sample = SimpleNamespace(header=number, payload_ptr=ctypes.addressof(memory))
        self.assertTrue(seal.holds(seed, header, sample, size))
        head = (ctypes.c_ubyte * ctypes.sizeof(header)).from_buffer(header)
        body = (ctypes.c_ubyte * records.nbytes).from_buffer(memory)
        for place in (head, body):
            for bit in range(8 * len(place)):
                place[bit // 8] ^= 1 << bit % 8
                self.assertFalse(seal.holds(seed, header, sample, size), (len(place), bit))
                place[bit // 8] ^= 1 << bit % 8
        self.assertTrue(seal.holds(seed, header, sample, size))
        self.assertFalse(seal.holds(seal.seed("clearway/other/v1/command"), header, sample, size))
        for wrong in (0, 7, 9, 2**40):
            number.number_of_elements = wrong
            self.assertFalse(seal.holds(seed, header, sample, size))


class InSharedMemory(WorldTestCase):
    def _flip(self, sample, at):
        """Flips a bit of a sample where it lies, through the file that is mapped there."""
        address = sample._sample.payload_ptr + at
        with open("/proc/self/maps") as maps:
            for line in maps:
                span, _, start, *_, path = line.split()
                first, last = (int(part, 16) for part in span.split("-"))
                if first <= address < last:
                    self.assertIn(self.prefix, path)
                    with open(path, "r+b") as file:
                        file.seek(int(start, 16) + address - first)
                        byte = file.read(1)[0]
                        file.seek(-1, 1)
                        file.write(bytes([byte ^ 4]))
                    return
        self.fail("the sample is not mapped")

    def test_a_reader_leaves_out_what_changed_in_memory(self):
        self.daemon(period_us=20_000)
        watcher, reader = self.attach(), self.attach()
        lax = self.attach(verify=False)
        newest = until(reader.states.newest)
        self.assertTrue(newest.is_intact())
        # Hit before another reader looks: a reader that never asked before gets the newest sample.
        until(lax.states.newest)

        def hit():
            sample = watcher.states.newest()
            if sample is None:
                return False
            self._flip(sample, 8)
            self.assertFalse(sample.is_intact())
            tick, before = sample.header.tick, reader.states.corrupt
            strict, loose = reader.states.newest(), lax.states.newest()
            unseen = strict is None or strict.header.tick != tick
            seen = loose is not None and loose.header.tick == tick and not loose.is_intact()
            return unseen and seen and reader.states.corrupt > before

        until(hit)
        self.assertEqual(lax.states.corrupt, 0)
        self.assertTrue(until(reader.states.newest).is_intact())

    def test_the_daemon_refuses_what_is_not_sealed_and_counts_it(self):
        daemon = self.daemon("--set", "source.kind=observation", "--set", "source.max_age_us=5_000_000")
        client = self.attach()
        client.admin.timeout_s = 60.0
        sample = client.states.wait(PATIENCE_S)
        ids = sample.robots["id"].copy()
        poses = np.column_stack([sample.robots[axis] for axis in ("x_m", "y_m", "theta_rad")])
        del sample
        publisher = client.observations(len(ids))
        good, publisher._seed = publisher._seed, seal.seed("clearway/another/v1/observation")

        def refused():
            publisher.publish(ids, poses)
            return client.admin.status().figures.rejected_inputs > 0

        until(refused)
        newest = until(client.states.newest)
        self.assertFalse((newest.robots["flags"] & StateFlags.VALID).any())
        del newest
        publisher._seed = good

        def seen():
            publisher.publish(ids, poses)
            newest = client.states.newest()
            return newest is not None and bool((newest.robots["flags"] & StateFlags.VALID).all())

        until(seen)
        rejected = self.stop(daemon)["rejected_inputs"]
        self.assertGreater(rejected["corrupt"], 0)
        self.assertEqual(sum(rejected.values()), rejected["corrupt"], rejected)
