"""The rows of the paper's programme and of the corrected one, as numbers for one robot and period.

Both are written down here from docs/MATH.md and the paper, apart from the Rust code that they are
held against. Defaults are those of `clearway`. Units: m, s, rad and products of them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from .motion import closest_on_segment, wrap
from .scenario import Limits, Scenario

Pose = tuple[float, float, float]

C3, ALPHA = 0.5, 0.6
WEIGHTS = {"v": 1.0, "omega": 0.5, "position": 1e3, "heading": 1e4, "comfort": 1e4}
# Barrier rates per period of the corrected programme: hard rows and comfort rows.
GAMMA, COMFORT_GAMMA = 1.0, 0.9
# The paper's barrier rate per second, and its activation threshold ε_r of (32) in the unit of B, m².
PRINTED_GAMMA_PER_S, PRINTED_ACTIVATION_M2 = 0.6, 1.5


@dataclass(frozen=True, slots=True)
class Certificate:
    """linear·x + ½ curvature·x² ≤ −decrease + slack."""

    linear: float
    curvature: float
    decrease: float

    def as_dict(self) -> dict[str, float]:
        """As `ipopt.py` reads it."""
        return {"linear": self.linear, "curvature": self.curvature, "decrease": self.decrease}


def finite_time(lyapunov: float) -> float:
    """Definition 2: min{V, c₃V^α}."""
    return min(lyapunov, C3 * lyapunov**ALPHA)


def goal_errors(p: Pose, goal_m: tuple[float, float]) -> tuple[float, float, float]:
    """Distance to the goal, its component along the heading, and the heading's error e."""
    dx, dy = goal_m[0] - p[0], goal_m[1] - p[1]
    along = dx * math.cos(p[2]) + dy * math.sin(p[2])
    return math.hypot(dx, dy), along, wrap(p[2] - math.atan2(dy, dx))


def printed(
    p: Pose, goal_m: tuple[float, float], period_s: float, sign: float
) -> tuple[Certificate, Certificate]:
    """(33b) and (33c). `sign` is −1 for Q as printed below (33) and +1 for Definition 2.

    √cos e is imaginary beyond a right angle; 0 is taken there.
    """
    distance, along, e = goal_errors(p, goal_m)
    t2 = period_s * period_s
    heading = Certificate(
        period_s * math.sin(e), t2 * max(math.cos(e), 0.0), sign * finite_time(1.0 - math.cos(e))
    )
    return Certificate(-period_s * along, t2, sign * finite_time(0.5 * distance**2)), heading


def corrected(
    p: Pose, goal_m: tuple[float, float], period_s: float, limits: Limits
) -> tuple[Certificate, Certificate]:
    """(28) and (31) with decreases that the inputs can deliver (docs/MATH.md §3)."""
    distance, along, e = goal_errors(p, goal_m)
    t2 = period_s * period_s
    lyapunov, rest = 0.5 * distance**2, max(distance - limits.v_max_mps * period_s, 0.0)
    position = Certificate(-period_s * along, t2, min(finite_time(lyapunov), lyapunov - 0.5 * rest**2))
    reach = max(limits.omega_max_radps, -limits.omega_min_radps) * period_s
    rest = max(abs(e) - reach, 0.0)
    lyapunov = 1.0 - math.cos(e)
    decrease = min(finite_time(lyapunov), lyapunov - (1.0 - math.cos(rest)))
    return position, Certificate(period_s * math.sin(e), t2 * max(math.cos(rest), 0.0), decrease)


def printed_rows(
    scenario: Scenario, me: int, poses: list[Pose], last_v_mps: list[float], period_s: float
) -> list[tuple[float, float]]:
    """(33d) for every robot in (32): (a, b) of T²v² + a·v + b ≥ δ_r.

    ΔB has the other's input, which a distributed programme cannot know; its last one is taken.
    """
    limits, t = scenario.limits, period_s
    v_max = limits.v_max_mps
    omega_max = max(limits.omega_max_radps, -limits.omega_min_radps)
    x, y, theta = poses[me]
    hx, hy = math.cos(theta), math.sin(theta)
    rows = []
    for j, (ox, oy, otheta) in enumerate(poses):
        if j == me:
            continue
        dx, dy = x - ox, y - oy
        d2 = dx * dx + dy * dy
        barrier = d2 - scenario.required_m(me, j) ** 2
        if barrier > PRINTED_ACTIVATION_M2:
            continue
        # φ of (5): half of the largest second derivative of B.
        phi = 4.0 * v_max**2 + 2.0 * math.sqrt(d2) * v_max * omega_max
        wx, wy = last_v_mps[j] * math.cos(otheta), last_v_mps[j] * math.sin(otheta)
        a = 2.0 * t * (dx * hx + dy * hy) - 2.0 * t * t * (hx * wx + hy * wy)
        b = t * t * (wx * wx + wy * wy) - 2.0 * t * (dx * wx + dy * wy)
        rows.append((a, b + PRINTED_GAMMA_PER_S * t * barrier + t * t * phi))
    return rows


def corrected_rows(
    scenario: Scenario, me: int, poses: list[Pose], period_s: float
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Hard rows and comfort rows a·v ≤ b in form F2, without those that full speed cannot reach."""
    limits = scenario.limits
    here = poses[me][:2]
    bodies = [(other[:2], scenario.required_m(me, j), 0.5) for j, other in enumerate(poses) if j != me] + [
        (closest_on_segment(here, o.from_m, o.to_m), scenario.required_to_core_m(me, o), 1.0)
        for o in scenario.obstacles
    ]
    omega = max(limits.omega_max_radps, -limits.omega_min_radps)
    hard, comfort = [], []
    for point, required, share in bodies:
        distance = math.dist(here, point)
        bounds = [max(share * rate * (distance - required), 0.0) for rate in (GAMMA, COMFORT_GAMMA)]
        if min(bounds) >= limits.v_max_mps * period_s:
            continue
        a = approach_s(poses[me], point, distance, omega, period_s)
        for rows, bound in zip((hard, comfort), bounds, strict=True):
            if a * limits.v_max_mps > bound:
                rows.append((a, bound))
    return hard, comfort


def approach_s(
    p: Pose, point: tuple[float, float], distance_m: float, omega_radps: float, period_s: float
) -> float:
    """Most that unit speed approaches `point` within a period at any |ω| ≤ `omega_radps`, s."""
    nx, ny = ((p[0] - point[0]) / distance_m, (p[1] - point[1]) / distance_m)
    hx, hy = math.cos(p[2]), math.sin(p[2])
    normal, tangent = nx * hx + ny * hy, nx * hy - ny * hx
    turn = omega_radps * period_s
    bend = 0.5 * turn * abs(tangent) + max(normal, 0.0) * turn * turn / 6.0
    return max(period_s * (bend - normal), 0.0)


def speed_limit_mps(rows: list[tuple[float, float]], wanted_mps: float) -> float:
    """The largest speed up to `wanted_mps` that every row a·v ≤ b admits."""
    limit: Callable[[tuple[float, float]], float] = lambda row: row[1] / row[0]  # noqa: E731
    return min([wanted_mps, *(limit(row) for row in rows if row[0] > 0.0)])
