"""Exact motion under a held input, and the smallest distance over continuous time.

A robot that holds its input for a period moves on an arc (a unicycle) or on a straight line (a
holonomic robot, or ω = 0). The minimum distance is enclosed by branch and bound as in
`src/geometry/distance.rs`: a path stays within a·h²/8 of its chord over h seconds, where a bounds its
acceleration, so every chord gives a lower and an upper bound.
"""

import math
from typing import NamedTuple

# Width to which the enclosure of a minimum is refined, m.
RESOLUTION_M = 1e-12
# Halvings of the period after which an enclosure is accepted as it is.
DEPTH_MAX = 40


class Motion(NamedTuple):
    """A pose (m, m, rad) and the input (m/s, rad/s) held from there.

    For a holonomic robot `theta_rad` is the direction of its velocity and `omega_radps` is 0.
    """

    x_m: float
    y_m: float
    theta_rad: float
    v_mps: float
    omega_radps: float


def wrap(angle_rad: float) -> float:
    """The same angle in (−π, π], rad."""
    if -math.pi < angle_rad <= math.pi:
        return angle_rad
    r = angle_rad % math.tau
    return r - math.tau if r > math.pi else r


def position(m: Motion, s: float) -> tuple[float, float]:
    """Position after `s` seconds, m."""
    half = 0.5 * m.omega_radps * s
    sinc = 1.0 - half * half / 6.0 if abs(half) < 1e-4 else math.sin(half) / half
    chord = m.v_mps * s * sinc
    return m.x_m + chord * math.cos(m.theta_rad + half), m.y_m + chord * math.sin(m.theta_rad + half)


def pose(m: Motion, s: float) -> tuple[float, float, float]:
    """Pose after `s` seconds (m, m, rad)."""
    return *position(m, s), wrap(m.theta_rad + m.omega_radps * s)


def min_distance(a: Motion, b: Motion, period_s: float) -> float:
    """Smallest distance of two centres over [0, `period_s`], m, at most `RESOLUTION_M` too large."""
    turning = a.v_mps * a.omega_radps, b.v_mps * b.omega_radps
    jerk = abs(turning[0] * a.omega_radps) + abs(turning[1] * b.omega_radps)

    def path(s: float) -> tuple[float, float]:
        (ax, ay), (bx, by) = position(a, s), position(b, s)
        return ax - bx, ay - by

    def acceleration(middle: float, h: float) -> float:
        if turning == (0.0, 0.0):
            return 0.0
        # Centripetal accelerations at the middle, plus how far they can change from there.
        ta, tb = a.theta_rad + a.omega_radps * middle, b.theta_rad + b.omega_radps * middle
        x = turning[0] * math.sin(ta) - turning[1] * math.sin(tb)
        y = turning[0] * math.cos(ta) - turning[1] * math.cos(tb)
        return math.hypot(x, y) + 0.5 * h * jerk

    return _refine(period_s, path, acceleration, ((0.0, 0.0), (0.0, 0.0)))


def min_distance_to_segment(
    m: Motion, start: tuple[float, float], end: tuple[float, float], period_s: float
) -> float:
    """Smallest distance from a centre to a segment over [0, `period_s`], m."""
    turning = abs(m.v_mps * m.omega_radps)
    return _refine(period_s, lambda s: position(m, s), lambda _middle, _h: turning, (start, end))


def _refine(period_s, path, acceleration, target) -> float:  # noqa: ANN001
    """Upper end of the enclosure of the path's smallest distance to the segment `target`, m."""
    first, last = path(0.0), path(period_s)
    upper = min(segment_distance(first, first, *target), segment_distance(last, last, *target))
    waiting = [(0.0, period_s, first, last, 0)]
    while waiting:
        from_s, to_s, p, q, depth = waiting.pop()
        h, middle_s = to_s - from_s, 0.5 * (from_s + to_s)
        deviation = acceleration(middle_s, h) * h * h / 8.0
        chord = segment_distance(p, q, *target)
        upper = min(upper, chord + deviation)
        if chord - deviation >= upper - RESOLUTION_M or deviation <= 0.5 * RESOLUTION_M or depth == DEPTH_MAX:
            continue
        middle = path(middle_s)
        halves = [(from_s, middle_s, p, middle, depth + 1), (middle_s, to_s, middle, q, depth + 1)]
        # The nearer half is taken first: its bound prunes the other.
        halves.sort(key=lambda half: -segment_distance(half[2], half[3], *target))
        waiting += halves
    return upper


def closest_on_segment(
    point: tuple[float, float], p: tuple[float, float], q: tuple[float, float]
) -> tuple[float, float]:
    """The point of the segment p–q nearest to `point`."""
    dx, dy = q[0] - p[0], q[1] - p[1]
    length2 = dx * dx + dy * dy
    if length2 == 0.0:
        return p
    t = ((point[0] - p[0]) * dx + (point[1] - p[1]) * dy) / length2
    t = min(max(t, 0.0), 1.0)
    return p[0] + t * dx, p[1] + t * dy


def segment_distance(
    p: tuple[float, float], q: tuple[float, float], r: tuple[float, float], s: tuple[float, float]
) -> float:
    """Distance of the segments p–q and r–s; either may be a point. 0 where they cross."""
    if p != q and r != s and _crosses(p, q, r, s):
        return 0.0
    ends = [(p, r, s), (q, r, s), (r, p, q), (s, p, q)]
    return min(math.dist(point, closest_on_segment(point, a, b)) for point, a, b in ends)


def _crosses(p, q, r, s) -> bool:  # noqa: ANN001
    def side(a, b, c) -> float:  # noqa: ANN001
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    return side(p, q, r) * side(p, q, s) < 0.0 and side(r, s, p) * side(r, s, q) < 0.0
