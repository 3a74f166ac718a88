"""Python publishes what robots do, and the daemon drives them."""

import itertools
import math
import re
import signal

import numpy as np

import clearway
from clearway import AdminFlags, Holding, StateFlags

from .world import PACKAGE, PATIENCE_S, WorldTestCase, until

EXAMPLES = PACKAGE / "examples"


def attached(client):
    """Who the daemon says is there: readers of states, writers of observations, clients of admin."""
    figures = client.admin.status().figures
    return figures.state_readers, figures.observation_writers, figures.admin_clients


class Driving(WorldTestCase):
    def test_a_plant_in_python_takes_everybody_to_the_goal(self):
        daemon = self.daemon(
            "--scenario", "swap8", "--set", "source.kind=observation", period_us=80_000, endless=False
        )
        plant = self.python(str(EXAMPLES / "drive.py"))
        report = self.report(daemon)
        self.assertEqual((report["arrived"], report["violations"]), (8, 0), report)
        self.assertEqual(report["ended_by"], "finished")
        self.assertGreater(report["min_clearance_m"], 0.0)
        said = self.ended(plant)
        # The plant's own robots stand inside the tolerance of their goals, 0.05 m.
        goals = [(4.5, 0.0), (-4.5, 0.0), (0.0, -4.5), (0.0, 4.2)]
        places = re.findall(r"robot (\d+): \((.*), (.*)\) m", said)
        self.assertEqual(len(places), 8, said)
        for robot, x_m, y_m in places[:4]:
            goal = goals[int(robot)]
            self.assertLess(math.dist((float(x_m), float(y_m)), goal), 0.06, said)

    def test_observations_are_taken_and_strange_ones_counted(self):
        daemon = self.daemon("--set", "source.kind=observation", "--set", "source.max_age_us=5_000_000")
        client = self.attach()
        client.admin.timeout_s = 60.0
        self.assertTrue(client.admin.status().flags & AdminFlags.OBSERVED)
        sample = client.states.wait(PATIENCE_S)
        self.assertFalse((sample.robots["flags"] & StateFlags.VALID).any())
        ids = sample.robots["id"].copy()
        poses = np.column_stack([sample.robots[axis] for axis in ("x_m", "y_m", "theta_rad")])
        del sample
        until(lambda: client.admin.status().figures.unseen == 8)

        def seen(count):
            client.observe(ids, poses)
            newest = client.states.newest()
            return newest and (newest.robots["flags"] & StateFlags.VALID > 0).sum() == count

        until(lambda: seen(8))
        # A second publisher may not speak for robots that the first one speaks for.
        before = client.admin.status().figures.rejected_inputs
        other = client.observations(1)
        other.publish(ids[:1], poses[:1])
        self.assertEqual(other.sequence, 1)
        until(lambda: seen(8) and client.admin.status().figures.rejected_inputs > before)
        until(lambda: client.admin.status().figures.observation_writers == 2)
        report = self.stop(daemon)
        self.assertGreater(sum(report["rejected_inputs"].values()), 0)

    def test_what_is_not_an_observation_is_refused_here(self):
        self.daemon("--set", "source.kind=observation")
        client = self.attach()
        publisher = client.observations(2)
        wrong = [
            ([0, 1], [[0.0, 0.0, 0.0]]),
            ([0], [0.0, 0.0, 0.0]),
            ([[0]], [[0.0, 0.0, 0.0]]),
            ([-1], [[0.0, 0.0, 0.0]]),
            ([2**32], [[0.0, 0.0, 0.0]]),
            ([0.5], [[0.0, 0.0, 0.0]]),
            ([True], [[0.0, 0.0, 0.0]]),
            (["0"], [[0.0, 0.0, 0.0]]),
            ([0, 1, 2], np.zeros((3, 3))),
        ]
        for ids, poses in wrong:
            with self.assertRaises(ValueError):
                publisher.publish(ids, poses)
        for holding in ([1], [[1, 1]], [1, -1], [1, 2**32], [1.0, 1.0], ["1", "1"]):
            with self.assertRaises(ValueError):
                publisher.publish([0, 1], np.zeros((2, 3)), holding=holding)
        self.assertEqual(publisher.sequence, 0)
        # Nothing was left borrowed.
        for _ in itertools.repeat(None, 20):
            publisher.publish(np.array([1, 0], np.uint32), [(5.0, 0.4, 0), (-5.0, -0.4, 0)])
        self.assertEqual(publisher.sequence, 20)
        publisher.publish([1, 0], np.zeros((2, 3)), holding=[Holding.NOTHING, Holding.command(7)])
        publisher.publish([1, 0], np.zeros((2, 3)), holding=np.array([0, 2**32 - 1], np.uint32))
        self.assertEqual(publisher.sequence, 22)

    def test_a_daemon_with_its_own_plant_takes_no_observations(self):
        self.daemon()
        with self.assertRaisesRegex(clearway.NotObservedError, "source.kind"):
            self.attach().observe([0], [[0.0, 0.0, 0.0]])

    def test_killing_a_client_does_not_disturb_the_daemon(self):
        daemon = self.daemon("--set", "source.kind=observation", "--set", "source.max_age_us=5_000_000")
        client = self.attach()
        client.admin.timeout_s = 60.0
        client.states.wait(PATIENCE_S)
        code = """
import clearway, itertools, time
client = clearway.attach(wait_s=60)
held = [channel.wait(60) for channel in (client.states, client.commands, client.telemetry)]
client.admin.timeout_s = 60
client.admin.status()
for i in itertools.count():
    client.observe([0], [[-5.0, -0.4, 0.0]])
    if i == 3:
        print("busy", flush=True)
    time.sleep(0.001)
"""
        victim = self.python("-c", code)
        self.assertEqual(victim.stdout.readline().strip(), "busy")
        # The daemon counts about once a second: this client, and the victim with its two readers of states.
        until(lambda: attached(client) == (3, 1, 2))
        victim.send_signal(signal.SIGKILL)
        victim.communicate()
        # It goes on at once, and its housekeeping takes the dead client's place away.
        tick = client.states.wait(PATIENCE_S).header.tick
        until(lambda: (s := client.states.newest()) and s.header.tick > tick + 50)
        until(lambda: attached(client) == (1, 0, 1))
        figures = client.admin.status().figures
        self.assertEqual((figures.worker_panics, figures.lost_records), (0, 0))
        self.assertEqual(self.stop(daemon)["violations"], 0)
