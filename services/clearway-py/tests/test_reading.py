"""States, commands and telemetry of a real daemon, where they lie."""

import gc
import signal
import time

import numpy as np

import clearway
from clearway import StateFlags, StopReason
from clearway.layout import RobotState

from .world import PATIENCE_S, WorldTestCase, until


def mapping_at(address: int) -> str:
    """The line of this process's memory map that an address belongs to."""
    with open("/proc/self/maps") as maps:
        for line in maps:
            first, last = (int(end, 16) for end in line.split()[0].split("-"))
            if first <= address < last:
                return line
    return ""


class Reading(WorldTestCase):
    def test_states_commands_and_telemetry_come_in_order(self):
        daemon = self.daemon()
        client = self.attach()
        self.assertEqual(client.fleet, "default")
        commands, telemetry, ticks = {}, {}, []
        client.commands, client.telemetry  # noqa: B018 - read from here on
        for sample in client.states.stream(PATIENCE_S):
            ticks.append(sample.header.tick)
            self.assertEqual(list(sample.robots["id"]), list(range(8)))
            self.assertTrue((sample.robots["flags"] & StateFlags.VALID).all())
            self.assertEqual(sample.header.period_ns, 10_000_000)
            if len(ticks) >= 30:
                break
        while (command := client.commands.next()) is not None:
            commands[command.header.tick] = command.robots.copy()
            self.assertGreater(command.header.valid_until_ns, command.header.valid_from_ns)
        while (record := client.telemetry.next()) is not None:
            telemetry[record.header.tick] = record.robots.copy()
        self.assertEqual(ticks, sorted(set(ticks)))
        # What telemetry says of the answer to a state is what goes out one period later.
        both = [tick for tick in telemetry if tick + 1 in commands]
        self.assertGreater(len(both), 10)
        for tick in both:
            for field in ("id", "stop_reason", "v_mps", "omega_radps"):
                np.testing.assert_array_equal(telemetry[tick][field], commands[tick + 1][field])
        moved = sum(float(robots["v_mps"].sum()) for robots in commands.values())
        self.assertGreater(moved, 1.0)
        self.assertEqual(self.stop(daemon)["violations"], 0)

    def test_arrays_lie_in_shared_memory_for_reading_only(self):
        self.daemon()
        sample = self.attach().states.wait(PATIENCE_S)
        address = sample.robots.__array_interface__["data"][0]
        line = mapping_at(address)
        self.assertIn("/dev/shm/" + self.prefix, line)
        # The last byte as well.
        self.assertEqual(mapping_at(address + sample.robots.nbytes - 1), line)
        self.assertEqual(sample.robots.dtype, RobotState.dtype())
        self.assertTrue(np.shares_memory(sample.robots, sample.robots["intent"]["rank"]))
        for array in (sample.robots, sample.robots["x_m"], sample.robots[1:], sample.robots.view()):
            self.assertFalse(array.flags.writeable)
            with self.assertRaises(ValueError):
                array.setflags(write=True)
        with self.assertRaises(ValueError):
            sample.robots["x_m"] = 0.0
        present = sample.present()
        self.assertFalse(np.shares_memory(present, sample.robots))
        self.assertTrue(present.flags.writeable)

    def test_a_view_keeps_its_sample_and_letting_go_gives_it_back(self):
        self.daemon()
        states = self.attach().states
        sample = states.wait(PATIENCE_S)
        held, robot, copied = sample.robots["x_m"], sample.robots[3], sample.robots.copy()
        del sample
        gc.collect()
        # A hundred periods would have overwritten it many times over.
        tick = states.wait(PATIENCE_S).header.tick
        until(lambda: (newest := states.newest()) and newest.header.tick > tick + 100)
        np.testing.assert_array_equal(held, copied["x_m"])
        self.assertEqual(robot.tobytes(), copied[3].tobytes())

    def test_hoarding_says_what_to_do_and_hurts_only_the_hoarder(self):
        daemon = self.daemon()
        client, other = self.attach(), self.attach()
        with self.assertRaisesRegex(clearway.TooManySamplesError, "copies"):
            hoard = [sample.robots for sample in client.states.stream(PATIENCE_S)]
        hoard = [client.commands.wait(PATIENCE_S).robots for _ in range(4)]
        with self.assertRaises(clearway.TooManySamplesError):
            until(client.commands.next)
        first = other.states.wait(PATIENCE_S).header.tick
        until(lambda: (newest := other.states.newest()) and newest.header.tick > first + 20)
        hoard.clear()
        self.assertIsNotNone(client.commands.wait(PATIENCE_S))
        self.assertEqual(self.stop(daemon)["violations"], 0)

    def test_a_sample_is_not_released_under_an_array(self):
        self.daemon()
        client = self.attach()
        sample = client.states.wait(PATIENCE_S)
        robots = sample.robots
        with self.assertRaises(clearway.SampleInUseError):
            sample.release()
        expected = robots.copy()
        del robots
        sample.release()
        sample.release()
        with self.assertRaises(clearway.ReleasedError):
            sample.robots  # noqa: B018
        self.assertIn("released", repr(sample))
        # A block gives it back, and an array that leaves the block stays good.
        with client.states.wait(PATIENCE_S) as sample:
            kept = sample.robots
        self.assertEqual(kept["goal_x_m"].tolist(), expected["goal_x_m"].tolist())
        # So does one that outlives the client.
        client.close()
        self.assertEqual(kept["goal_x_m"].tolist(), expected["goal_x_m"].tolist())
        for use in (lambda: client.states, lambda: client.admin, lambda: client.observe([0], [[0, 0, 0]])):
            self.assertRaises(clearway.ReleasedError, use)

    def test_what_came_from_a_closed_client_says_so(self):
        self.daemon("--set", "source.kind=observation")
        with self.attach() as client:
            states, admin, observations = client.states, client.admin, client.observations(1)
        for use in (states.next, states.wait, admin.status, lambda: observations.publish([0], [[0, 0, 0]])):
            self.assertRaises(clearway.ReleasedError, use)

    def test_the_clock_is_pythons_monotonic_one(self):
        self.assertIn("CLOCK_MONOTONIC", time.get_clock_info("monotonic").implementation)
        self.daemon()
        admin = self.attach().admin
        before_ns = time.monotonic_ns()
        answered_ns = admin.status().figures.stamp_ns
        self.assertLessEqual(before_ns, answered_ns)
        self.assertLessEqual(answered_ns, time.monotonic_ns())

    def test_a_reader_that_stays_hears_the_next_daemon(self):
        daemon = self.daemon()
        client = self.attach()
        first = client.states.wait(PATIENCE_S).header.epoch
        daemon.send_signal(signal.SIGKILL)
        daemon.communicate()
        list(client.states.stream(0.0))
        self.assertIsNone(client.states.wait(0.05))
        successor = self.daemon()
        until(lambda: (sample := client.states.newest()) and sample.header.epoch > first)
        self.stop(successor)

    def test_the_last_command_is_a_stop(self):
        daemon = self.daemon()
        client = self.attach()
        client.commands.wait(PATIENCE_S)
        self.stop(daemon)
        last = client.commands.newest()
        self.assertEqual(set(last.robots["stop_reason"]), {StopReason.OPERATOR})
        self.assertEqual(set(last.robots["v_mps"]), {0.0})
        self.assertIsNone(client.commands.wait(0.0))
