"""ORCA by RVO2's own C++ code (PyPI `pyrvo`), holonomic and behind a unicycle tracker.

Every robot gets a disc of its radius plus half of the safety distance, so that touching discs are
exactly ρ apart. RVO2 computes in single precision: positions are integrated here in double
precision, and the discs are 10 µm larger so that rounding alone does not count as a violation.
"""

import math
import random
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import pyrvo

from . import certificates
from .law import Pose, Times
from .motion import Motion, wrap
from .roadmap import Roadmap
from .scenario import Obstacle, Scenario

# Against rounding in single precision, m.
ROUNDING_M = 1e-5
# Corners of the polygon that stands for the round end of an obstacle.
CORNERS = 16


@dataclass(frozen=True, slots=True)
class OrcaParameters:
    """RVO2's parameters.

    * `horizon_s`: avoid what would collide within this time. Small: late, collisions at speed.
      Large: timid, jams.
    * `neighbours`, `range_m`: how many others are looked at, and how far.
    * `inflation`: multiple of the disc, ≥ 1.
    * `perturbation`: random part of the preferred velocity, as a share of v_max; RVO2's examples add
      such a part against deadlocks of perfect symmetry.
    """

    horizon_s: float
    neighbours: int = 10
    range_m: float = 15.0
    inflation: float = 1.0
    perturbation: float = 1e-4

    def as_dict(self) -> dict:
        """The parameters under their names."""
        return asdict(self)


class Orca:
    """The holonomic law: RVO2 decides, and robots move at once with the velocity it says."""

    holonomic, memoryless, not_solved = True, False, 0

    def __init__(self, scenario: Scenario, period_s: float, parameters: OrcaParameters) -> None:
        self.scenario, self.period_s, self.parameters = scenario, period_s, parameters
        self.times, self.rng, self.roadmap = Times(), random.Random(1), Roadmap(scenario)
        p, limits = parameters, scenario.limits
        half_gap = 0.5 * limits.safety_margin_m
        self.simulator = pyrvo.RVOSimulator(
            period_s, p.range_m, p.neighbours, p.horizon_s, p.horizon_s, 1.0, limits.v_max_mps
        )
        for i, robot in enumerate(scenario.robots):
            self.simulator.add_agent(list(robot.start[:2]))
            radius = (robot.radius_m + half_gap) * p.inflation + ROUNDING_M
            self.simulator.set_agent_radius(i, radius)
        for obstacle in scenario.obstacles:
            # The discs hold half of the safety distance; the obstacle gets the other half.
            self.simulator.add_obstacle(polygon(obstacle, obstacle.reach_m + half_gap))
        if scenario.obstacles:
            self.simulator.process_obstacles()

    def velocities(self, poses: Sequence[Pose]) -> list[tuple[float, float]]:
        """RVO2's answer for every robot, m/s; what is timed is its `doStep`."""
        v_max = self.scenario.limits.v_max_mps
        for i, here in enumerate(poses):
            self.simulator.set_agent_position(i, [here[0], here[1]])
            self.simulator.set_agent_pref_velocity(i, self._preferred(i, here, v_max))
        self.times.timed(self.simulator.do_step)
        self.times.fleet_step_ns.append(self.times.solve_ns[-1])
        return [self.simulator.get_agent_velocity(i).to_tuple() for i in range(len(poses))]

    def decide(self, poses: Sequence[Pose]) -> list[Motion]:
        """Straight motions with RVO2's velocities."""
        v_max = self.scenario.limits.v_max_mps
        return [
            Motion(p[0], p[1], math.atan2(vy, vx), min(math.hypot(vx, vy), v_max), 0.0)
            for p, (vx, vy) in zip(poses, self.velocities(poses), strict=True)
        ]

    def _preferred(self, i: int, here: Pose, v_max: float) -> list[float]:
        """Towards the target, as fast as one may and so that one step does not overshoot, m/s."""
        goal = self.scenario.robots[i].goal_m
        if math.dist(here[:2], goal) <= 0.5 * self.scenario.tolerance_m:
            return [0.0, 0.0]
        x, y = self.roadmap.target(i, here[:2])
        dx, dy = x - here[0], y - here[1]
        distance = math.hypot(dx, dy)
        speed = v_max if (x, y) != goal else min(v_max, distance / self.period_s)
        scale = speed / distance if distance > 0.0 else 0.0
        angle = self.rng.uniform(0.0, math.tau)
        noise = self.rng.random() * self.parameters.perturbation * v_max
        return [dx * scale + noise * math.cos(angle), dy * scale + noise * math.sin(angle)]


@dataclass(frozen=True, slots=True)
class TrackerParameters:
    """How a unicycle follows ORCA's velocity.

    ω turns the heading onto the velocity's direction within one period where the limit allows;
    v = speed · max(0, 1 − |error|/`full_stop_rad`). `guarded`: v is cut to what our own hard rows
    admit, so that nobody collides whatever ORCA wants.
    """

    full_stop_rad: float
    guarded: bool = False

    def as_dict(self) -> dict:
        """The parameters under their names."""
        return asdict(self)


class TrackedOrca(Orca):
    """Unicycles that track ORCA's velocities; ORCA is told the velocities they really have."""

    holonomic = False

    def __init__(
        self, scenario: Scenario, period_s: float, parameters: OrcaParameters, tracker: TrackerParameters
    ) -> None:
        super().__init__(scenario, period_s, parameters)
        self.tracker = tracker
        self.last_v_mps = [0.0] * len(scenario.robots)

    def decide(self, poses: Sequence[Pose]) -> list[Motion]:
        """Arcs that follow RVO2's velocities within the limits of v and ω."""
        for i, (p, v) in enumerate(zip(poses, self.last_v_mps, strict=True)):
            self.simulator.set_agent_velocity(i, [v * math.cos(p[2]), v * math.sin(p[2])])
        motions = [self._track(p, wanted) for p, wanted in zip(poses, self.velocities(poses), strict=True)]
        if self.tracker.guarded:
            motions = [self._guard(i, list(poses), m) for i, m in enumerate(motions)]
        self.last_v_mps = [m.v_mps for m in motions]
        return motions

    def _track(self, p: Pose, wanted: tuple[float, float]) -> Motion:
        limits, speed = self.scenario.limits, math.hypot(*wanted)
        # Standing still has no direction.
        error = wrap(math.atan2(wanted[1], wanted[0]) - p[2]) if speed > 1e-3 else 0.0
        omega = min(max(error / self.period_s, limits.omega_min_radps), limits.omega_max_radps)
        v = speed * max(0.0, 1.0 - abs(error) / self.tracker.full_stop_rad)
        return Motion(*p, min(max(v, limits.v_min_mps), limits.v_max_mps), omega)

    def _guard(self, me: int, poses: list[Pose], m: Motion) -> Motion:
        hard, _ = certificates.corrected_rows(self.scenario, me, poses, self.period_s)
        return m._replace(v_mps=certificates.speed_limit_mps(hard, m.v_mps))


def polygon(obstacle: Obstacle, reach_m: float) -> list[list[float]]:
    """A convex polygon, counter-clockwise, that holds everything within `reach_m` of the obstacle."""
    (ax, ay), (bx, by) = obstacle.from_m, obstacle.to_m
    along = math.atan2(by - ay, bx - ax)
    out = reach_m / math.cos(math.pi / CORNERS)
    half = CORNERS // 2
    corners = []
    for (x, y), first in (((bx, by), along - math.pi / 2), ((ax, ay), along + math.pi / 2)):
        for k in range(half):
            angle = first + math.tau * (k + 0.5) / CORNERS
            corners.append([x + out * math.cos(angle), y + out * math.sin(angle)])
    return corners
