import math
import random
import unittest

from closed_loop import certificates
from closed_loop.law import LimitError, Times, run
from closed_loop.motion import Motion, position
from closed_loop.roadmap import Roadmap
from closed_loop.scenario import parse

try:
    from closed_loop.orca import Orca, OrcaParameters, TrackedOrca, TrackerParameters
    from closed_loop.programme import CorrectedProgramme, PrintedProgramme
except ImportError as error:
    MISSING = str(error)
else:
    MISSING = ""

T = 0.08

CROSSING = """
schema = 1
name = "crossing"
duration_s = 20.0
[[robot]]
id = 0
radius_m = 0.15
start = { x_m = -2.0, y_m = 0.0 }
goal = { x_m = 2.0, y_m = 0.0 }
[[robot]]
id = 1
radius_m = 0.15
start = { x_m = 0.1, y_m = -3.0 }
goal = { x_m = 0.1, y_m = 3.0 }
"""

WALL = """
[[obstacle]]
segment = { from_m = [1.0, -1.0], to_m = [1.0, 1.5] }
"""


class Straight:
    """Everybody drives on at one speed until it is over the goal."""

    holonomic, memoryless, not_solved = False, True, 0

    def __init__(self, scenario, v_mps):
        self.scenario, self.v_mps, self.times = scenario, v_mps, Times()

    def decide(self, poses):
        robots = zip(self.scenario.robots, poses, strict=True)
        return [Motion(*p, 0.0 if math.dist(p[:2], r.goal_m) < 0.05 else self.v_mps, 0.0) for r, p in robots]


class LoopTest(unittest.TestCase):
    def test_a_run_ends_one_second_after_the_last_arrival(self):
        scenario = parse(CROSSING)
        outcome = run(scenario, Straight(scenario, 5.0), T)
        self.assertEqual(outcome.ended_by, "arrival")
        self.assertAlmostEqual(outcome.figures.makespan_s, 1.2, delta=1e-9)
        self.assertEqual(outcome.figures.steps, 15 + math.ceil(1.0 / T) + 1)

    def test_a_fleet_that_stands_is_not_waited_for(self):
        scenario = parse(CROSSING)
        outcome = run(scenario, Straight(scenario, 0.0), T)
        self.assertEqual((outcome.ended_by, outcome.figures.arrived), ("standstill", 0))
        self.assertLess(outcome.figures.steps, 70)

    def test_nobody_drives_faster_than_allowed(self):
        scenario = parse(CROSSING)
        with self.assertRaises(LimitError):
            run(scenario, Straight(scenario, 5.1), T)


class RoadmapTest(unittest.TestCase):
    def test_ways_lead_around_walls_and_end_at_the_goal(self):
        scenario = parse(CROSSING + WALL)
        roadmap = Roadmap(scenario)
        here, points = scenario.robots[0].start[:2], 0
        while (target := roadmap.target(0, here)) != scenario.robots[0].goal_m:
            self.assertTrue(roadmap.sees(here, target))
            here, points = target, points + 1
            self.assertLess(points, 10)
        self.assertTrue(roadmap.sees(here, target))
        # The nearer end of the wall is the lower one.
        self.assertLess(here[1], 0.0)
        self.assertEqual(roadmap.target(1, scenario.robots[1].start[:2]), scenario.robots[1].goal_m)


class CertificatesTest(unittest.TestCase):
    def test_the_approach_of_a_hard_row_bounds_every_motion(self):
        rng = random.Random(3)
        for _ in range(300):
            p = (rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-math.pi, math.pi))
            point = (rng.uniform(-1, 1), rng.uniform(-1, 1))
            d = math.dist(p[:2], point)
            v, omega = rng.uniform(0, 5), rng.uniform(-1, 1)
            ends = [position(Motion(*p, v, omega), T * k / 50) for k in range(51)]
            n = (p[0] - point[0]) / d, (p[1] - point[1]) / d
            moved = max(-(n[0] * (x - p[0]) + n[1] * (y - p[1])) for x, y in ends)
            self.assertLessEqual(moved, v * certificates.approach_s(p, point, d, 1.0, T) + 1e-12)

    def test_an_aligned_robot_can_meet_its_corrected_certificate_and_not_the_printed_one(self):
        limits = parse(CROSSING).limits
        for sign, reachable in ((1.0, False), (None, True)):
            p, goal = (0.0, 0.0, 0.0), (9.5, 0.0)
            c = (
                certificates.corrected(p, goal, T, limits)
                if sign is None
                else certificates.printed(p, goal, T, sign)
            )[0]
            left = c.linear * 5.0 + 0.5 * c.curvature * 25.0 + c.decrease
            self.assertEqual(left <= 1e-9, reachable)

    def test_the_printed_rows_admit_contact_at_full_speed(self):
        scenario = parse(CROSSING)
        poses = [(0.0, 0.0, 0.0), (0.46, 0.0, math.pi)]
        ((a, b),) = certificates.printed_rows(scenario, 0, poses, [0.0, 5.0], T)
        self.assertGreater((T * 5.0) ** 2 + a * 5.0 + b, 0.0)


@unittest.skipIf(MISSING, f"the peers' packages are not installed: {MISSING}")
class PeersTest(unittest.TestCase):
    def outcome(self, law, text=CROSSING):
        scenario = parse(text)
        return run(scenario, law(scenario), T)

    def test_orca_passes_a_crossing_without_a_violation(self):
        for text in (CROSSING, CROSSING + WALL):
            f = self.outcome(lambda s: Orca(s, T, OrcaParameters(2.0)), text).figures
            self.assertTrue(f.passed, f)

    def test_unicycles_track_orca_through_a_crossing(self):
        for guarded in (False, True):
            tracker = TrackerParameters(0.5, guarded)
            law = lambda s: TrackedOrca(s, T, OrcaParameters(2.0, inflation=1.2), tracker)  # noqa: E731, B023
            f = self.outcome(law).figures
            self.assertTrue(f.passed, f)
            self.assertGreater(f.omega_variation_rad, 0.0)

    def test_the_programmes_are_solved_every_time(self):
        for law in (lambda s: PrintedProgramme(s, T, 1.0), lambda s: CorrectedProgramme(s, T)):
            outcome = self.outcome(law)
            self.assertEqual(outcome.not_solved, 0)
            self.assertEqual(outcome.figures.arrived, 2)

    def test_with_the_printed_sign_everybody_stands_still(self):
        outcome = self.outcome(lambda s: PrintedProgramme(s, T, -1.0))
        self.assertEqual((outcome.ended_by, outcome.figures.arrived), ("standstill", 0))


if __name__ == "__main__":
    unittest.main()
