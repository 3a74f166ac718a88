"""The figures of merit of a run, with the definitions of `clearway eval` (`src/figures/mod.rs`)."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from .motion import Motion, closest_on_segment, min_distance, min_distance_to_segment, wrap
from .scenario import Limits, Robot, Scenario

# A pair closer than this below its required distance counts as violated, m.
VIOLATION_M = -1e-9
# A robot stalls when it neither moved nor turned by more than these for so long, away from its goal.
STALL_S, STALL_MOVE_M, STALL_TURN_RAD = 1.0, 0.01, 0.1


@dataclass(frozen=True, slots=True)
class Figures:
    """One run's figures; the keys and units are those of `clearway eval --jsonl`."""

    robots: int
    arrived: int
    stalled: int
    violations: int
    min_clearance_m: float | None
    steps: int
    makespan_s: float | None
    mean_arrival_s: float | None
    arrival_ratio: float | None
    arrival_ratio_after_turn: float | None
    path_ratio: float | None
    omega_variation_rad: float | None

    def as_dict(self) -> dict:
        """The figures under their keys."""
        return asdict(self)

    @property
    def passed(self) -> bool:
        """Everybody arrived and no pair came closer than it may."""
        return self.arrived == self.robots and self.violations == 0


def first_turn_s(robot: Robot, limits: Limits) -> float:
    """Time for the turn on the spot from the first heading towards the goal, s."""
    dx, dy = robot.goal_m[0] - robot.start[0], robot.goal_m[1] - robot.start[1]
    error_rad = wrap(math.atan2(dy, dx) - robot.start[2])
    rate = limits.omega_max_radps if error_rad >= 0.0 else -limits.omega_min_radps
    return abs(error_rad) / rate if math.hypot(dx, dy) > 0.0 and rate > 0.0 else 0.0


class _Track:
    """One robot's running sums."""

    __slots__ = ("arrived_s", "driven_m", "omega_radps", "omega_variation", "progress", "stalled")

    def __init__(self, robot: Robot) -> None:
        self.arrived_s: float | None = None
        self.driven_m = self.omega_radps = self.omega_variation = 0.0
        self.progress = (robot.start, 0.0)
        self.stalled = False

    def observe(self, m: Motion, inside: bool, now_s: float, period_s: float) -> None:
        if inside:
            self.arrived_s = now_s if self.arrived_s is None else self.arrived_s
        else:
            self.arrived_s = None
        (x, y, theta), since_s = self.progress
        moved = math.hypot(m.x_m - x, m.y_m - y) > STALL_MOVE_M
        turned = abs(wrap(m.theta_rad - theta)) > STALL_TURN_RAD
        if moved or turned or inside:
            self.progress = (m[:3], now_s)
        elif now_s - since_s >= STALL_S:
            self.stalled = True
        self.driven_m += abs(m.v_mps) * period_s
        self.omega_variation += abs(m.omega_radps - self.omega_radps)
        self.omega_radps = m.omega_radps


class Evaluator:
    """Collects the figures of one run, a period at a time."""

    def __init__(self, scenario: Scenario, period_s: float, holonomic: bool = False) -> None:
        """`holonomic`: the robots have no heading of their own, so ∫|dω| has no value."""
        self.scenario, self.period_s, self.holonomic = scenario, period_s, holonomic
        self.tracks = [_Track(robot) for robot in scenario.robots]
        self.violated: set[tuple[str, int, int]] = set()
        self.min_clearance_m = math.inf
        self.steps = 0

    def observe(self, tick: int, fleet: Sequence[Motion]) -> None:
        """Adds the period that starts at `tick` with `fleet` and the inputs held over it."""
        now_s = tick * self.period_s
        self.steps += 1
        for robot, track, m in zip(self.scenario.robots, self.tracks, fleet, strict=True):
            missing = math.hypot(m.x_m - robot.goal_m[0], m.y_m - robot.goal_m[1])
            track.observe(m, missing <= self.scenario.tolerance_m, now_s, self.period_s)
        for i, a in enumerate(fleet):
            for j in range(i):
                self._pair(i, j, a, fleet[j])
            self._obstacles(i, a)

    def _pair(self, i: int, j: int, a: Motion, b: Motion) -> None:
        required = self.scenario.required_m(i, j)
        apart = math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) - required
        # Neither the minimum nor a violation can come from further away than they can drive.
        if apart - (abs(a.v_mps) + abs(b.v_mps)) * self.period_s <= max(self.min_clearance_m, 0.0):
            self._note(("robots", i, j), min_distance(a, b, self.period_s) - required)

    def _obstacles(self, i: int, m: Motion) -> None:
        here = m.x_m, m.y_m
        for k, obstacle in enumerate(self.scenario.obstacles):
            required = self.scenario.required_to_core_m(i, obstacle)
            apart = math.dist(here, closest_on_segment(here, obstacle.from_m, obstacle.to_m)) - required
            if apart - abs(m.v_mps) * self.period_s <= max(self.min_clearance_m, 0.0):
                nearest = min_distance_to_segment(m, obstacle.from_m, obstacle.to_m, self.period_s)
                self._note(("obstacle", i, k), nearest - required)

    def _note(self, pair: tuple[str, int, int], clearance_m: float) -> None:
        self.min_clearance_m = min(self.min_clearance_m, clearance_m)
        if clearance_m < VIOLATION_M:
            self.violated.add(pair)

    @property
    def all_arrived(self) -> bool:
        """Every robot is inside the tolerance of its goal."""
        return all(track.arrived_s is not None for track in self.tracks)

    def finish(self) -> Figures:
        """The figures so far."""
        limits, tolerance_m = self.scenario.limits, self.scenario.tolerance_m
        arrivals = [track.arrived_s for track in self.tracks if track.arrived_s is not None]
        after_turn, ratios, paths = [], [], []
        for robot, track in zip(self.scenario.robots, self.tracks, strict=True):
            straight_m = math.dist(robot.start[:2], robot.goal_m)
            if track.arrived_s is None or straight_m <= tolerance_m:
                continue
            ratios.append(track.arrived_s * limits.v_max_mps / straight_m)
            turned_s = max(track.arrived_s - first_turn_s(robot, limits), 0.0)
            after_turn.append(turned_s * limits.v_max_mps / straight_m)
            paths.append(track.driven_m / straight_m)
        return Figures(
            robots=len(self.tracks),
            arrived=len(arrivals),
            stalled=sum(track.stalled for track in self.tracks),
            violations=len(self.violated),
            min_clearance_m=self.min_clearance_m if math.isfinite(self.min_clearance_m) else None,
            steps=self.steps,
            makespan_s=max(arrivals) if self.all_arrived else None,
            mean_arrival_s=_mean(arrivals),
            arrival_ratio=_mean(ratios),
            arrival_ratio_after_turn=None if self.holonomic else _mean(after_turn),
            path_ratio=_mean(paths),
            omega_variation_rad=None if self.holonomic else _mean([t.omega_variation for t in self.tracks]),
        )


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None
