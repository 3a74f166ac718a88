import math
import random
import unittest

from closed_loop.motion import (
    Motion,
    min_distance,
    min_distance_to_segment,
    pose,
    position,
    segment_distance,
    wrap,
)

T = 0.08


def any_motion(rng):
    return Motion(
        rng.uniform(-1, 1),
        rng.uniform(-1, 1),
        rng.uniform(-3.1, 3.1),
        rng.uniform(0, 5),
        rng.choice([0.0, rng.uniform(-3, 3)]),
    )


class MotionTest(unittest.TestCase):
    def test_quarter_turn_of_unit_radius(self):
        x, y, theta = pose(Motion(1.0, 0.0, math.pi / 2, 1.0, 1.0), math.pi / 2)
        self.assertAlmostEqual(x, 0.0, delta=1e-15)
        self.assertAlmostEqual(y, 1.0, delta=1e-15)
        self.assertAlmostEqual(theta, math.pi, delta=1e-15)

    def test_wrap_keeps_to_its_interval(self):
        for angle, wrapped in [(0.5, 0.5), (math.pi, math.pi), (-math.pi, math.pi), (7.0, 7.0 - math.tau)]:
            self.assertAlmostEqual(wrap(angle), wrapped, delta=1e-15)

    def test_robots_that_pass_through_each_other_between_samples_meet(self):
        a, b = Motion(-0.2, 0.0, 0.0, 5.0, 0.0), Motion(0.2, 0.0, math.pi, 5.0, 0.0)
        self.assertLess(min_distance(a, b, T), 1e-12)
        self.assertAlmostEqual(math.dist(position(a, T), position(b, T)), 0.4, delta=1e-12)

    def test_concentric_motion_keeps_its_distance(self):
        a, b = Motion(1.0, 0.0, math.pi / 2, 1.0, 1.0), Motion(-1.0, 0.0, -math.pi / 2, 1.0, 1.0)
        self.assertAlmostEqual(min_distance(a, b, T), 2.0, delta=1e-11)

    def test_the_minimum_holds_against_dense_samples(self):
        rng = random.Random(1)
        times = [T * k / 2000 for k in range(2001)]
        for _ in range(100):
            a, b = any_motion(rng), any_motion(rng)
            sampled = min(math.dist(position(a, s), position(b, s)) for s in times)
            found = min_distance(a, b, T)
            self.assertLessEqual(found, sampled + 1e-11)
            # The relative speed is at most 10 m/s, so samples miss the minimum by at most 0.2 mm.
            self.assertLess(sampled - found, 2.01e-4)

    def test_the_minimum_to_a_segment_holds_against_dense_samples(self):
        rng = random.Random(2)
        times = [T * k / 2000 for k in range(2001)]
        for _ in range(100):
            m = any_motion(rng)
            p, q = ((rng.uniform(-1, 1), rng.uniform(-1, 1)) for _ in range(2))
            sampled = min(segment_distance(x, x, p, q) for x in (position(m, s) for s in times))
            found = min_distance_to_segment(m, p, q, T)
            self.assertLessEqual(found, sampled + 1e-11)
            self.assertLess(sampled - found, 1.01e-4)

    def test_segments_that_cross_touch(self):
        self.assertEqual(segment_distance((-1, 0), (1, 0), (0, -1), (0, 1)), 0.0)
        self.assertEqual(segment_distance((0, 0), (0, 0), (3, 4), (3, 4)), 5.0)
        self.assertEqual(segment_distance((0, 0), (1, 0), (0, 2), (1, 3)), 2.0)


if __name__ == "__main__":
    unittest.main()
