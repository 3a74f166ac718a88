import math
import unittest

from closed_loop.clearway import disagreements
from closed_loop.figures import Evaluator
from closed_loop.motion import Motion, pose
from closed_loop.scenario import parse

T = 0.08

PAIR = """
schema = 1
name = "pair"
[[robot]]
id = 3
radius_m = 0.15
start = { x_m = -2.0, y_m = 0.0 }
goal = { x_m = 2.0, y_m = 0.0 }
[[robot]]
id = 7
radius_m = 0.15
start = { x_m = 2.0, y_m = OFFSET, theta_rad = 3.141592653589793 }
goal = { x_m = -2.0, y_m = OFFSET }
"""

WALL = """
schema = 1
name = "wall"
[[robot]]
id = 0
radius_m = 0.15
start = { x_m = 0.0, y_m = 0.0, theta_rad = 1.0 }
goal = { x_m = 4.0, y_m = 0.0 }
[[obstacle]]
segment = { from_m = [2.0, 0.31], to_m = [3.0, 1.0] }
[[obstacle]]
circle = { x_m = 2.0, y_m = -0.75, radius_m = 0.5 }
"""


def drive(evaluator, inputs, periods):
    """Holds `inputs` for `periods` and then stands for one."""
    poses = [robot.start for robot in evaluator.scenario.robots]
    for tick in range(periods + 1):
        held = inputs if tick < periods else [(0.0, 0.0)] * len(inputs)
        fleet = [Motion(*p, *u) for p, u in zip(poses, held, strict=True)]
        evaluator.observe(tick, fleet)
        poses = [pose(m, T) for m in fleet]
    return evaluator.finish()


class FiguresTest(unittest.TestCase):
    def test_a_pair_that_passes_at_a_known_distance(self):
        scenario = parse(PAIR.replace("OFFSET", "0.5"))
        f = drive(Evaluator(scenario, T), [(5.0, 0.0), (5.0, 0.0)], 10)
        self.assertTrue(f.passed)
        self.assertAlmostEqual(f.min_clearance_m, 0.05, delta=1e-12)
        self.assertAlmostEqual(f.makespan_s, 0.8, delta=1e-12)
        self.assertAlmostEqual(f.arrival_ratio, 1.0, delta=1e-12)
        self.assertAlmostEqual(f.arrival_ratio_after_turn, 1.0, delta=1e-12)
        self.assertAlmostEqual(f.path_ratio, 1.0, delta=1e-12)
        self.assertEqual((f.steps, f.stalled, f.omega_variation_rad), (11, 0, 0.0))

    def test_a_collision_between_samples_is_a_violation_once(self):
        scenario = parse(PAIR.replace("OFFSET", "0.0"))
        f = drive(Evaluator(scenario, T), [(5.0, 0.0), (5.0, 0.0)], 10)
        self.assertEqual((f.arrived, f.violations), (2, 1))
        self.assertAlmostEqual(f.min_clearance_m, -0.45, delta=1e-12)
        self.assertFalse(f.passed)

    def test_who_passes_through_its_goal_has_not_arrived(self):
        scenario = parse(PAIR.replace("OFFSET", "2.0"))
        f = drive(Evaluator(scenario, T), [(5.0, 0.0), (5.0, 0.0)], 11)
        self.assertEqual((f.arrived, f.makespan_s, f.arrival_ratio), (0, None, None))

    def test_standing_away_from_the_goal_stalls_and_turning_does_not(self):
        scenario = parse(PAIR.replace("OFFSET", "2.0"))
        f = drive(Evaluator(scenario, T), [(0.0, 0.0), (0.0, 0.5)], 30)
        self.assertEqual(f.stalled, 1)
        # From rest to 0.5 rad/s and back, for one of two.
        self.assertAlmostEqual(f.omega_variation_rad, 0.5, delta=1e-12)

    def test_obstacles_keep_their_distance_and_the_first_turn_is_taken_off(self):
        scenario = parse(WALL)
        evaluator = Evaluator(scenario, T)
        fleet = [Motion(1.9, 0.0, 0.0, 5.0, 0.0)]
        evaluator.observe(0, fleet)
        # 0.31 m to the wall's end against 0.30 m, and 0.75 m to the pillar's centre against 0.80 m.
        self.assertAlmostEqual(evaluator.min_clearance_m, -0.05, delta=1e-12)
        self.assertEqual(len(evaluator.violated), 1)
        evaluator.observe(20, [Motion(4.0, 0.0, 0.0, 0.0, 0.0)])
        f = evaluator.finish()
        self.assertAlmostEqual(f.arrival_ratio, 1.6 / 0.8, delta=1e-12)
        self.assertAlmostEqual(f.arrival_ratio_after_turn, (1.6 - 1.0) / 0.8, delta=1e-12)

    def test_holonomic_robots_have_no_turn_rate(self):
        scenario = parse(PAIR.replace("OFFSET", "2.0"))
        f = drive(Evaluator(scenario, T, holonomic=True), [(5.0, 0.0), (5.0, 0.0)], 10)
        self.assertEqual((f.omega_variation_rad, f.arrival_ratio_after_turn), (None, None))

    def test_a_scenario_without_a_heading_faces_its_goal(self):
        scenario = parse(WALL.replace(", theta_rad = 1.0", "").replace("x_m = 4.0", "x_m = -4.0"))
        self.assertEqual(scenario.robots[0].start[2], math.pi)

    def test_disagreement_is_named(self):
        scenario = parse(PAIR.replace("OFFSET", "2.0"))
        f = drive(Evaluator(scenario, T), [(5.0, 0.0), (5.0, 0.0)], 10)
        result = {"scenario": "pair", **f.as_dict()}
        self.assertEqual(disagreements(f, result), [])
        for key, other in [("violations", 1), ("makespan_s", f.makespan_s + 1e-6), ("path_ratio", None)]:
            (line,) = disagreements(f, {**result, key: other})
            self.assertIn(key, line)


if __name__ == "__main__":
    unittest.main()
