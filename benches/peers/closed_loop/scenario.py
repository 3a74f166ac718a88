"""A scenario as data, read from the TOML that `clearway scenario NAME` prints."""

import math
import tomllib
from dataclasses import dataclass

DEFAULT_TOLERANCE_M = 0.05
DEFAULT_DURATION_S = 60.0


@dataclass(frozen=True, slots=True)
class Limits:
    """Input limits and the gap to keep between bodies."""

    v_min_mps: float = 0.0
    v_max_mps: float = 5.0
    omega_min_radps: float = -1.0
    omega_max_radps: float = 1.0
    safety_margin_m: float = 0.15


@dataclass(frozen=True, slots=True)
class Robot:
    """One robot: body radius, first pose (m, m, rad) and goal (m, m)."""

    id: int
    radius_m: float
    start: tuple[float, float, float]
    goal_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A static obstacle: everything within `reach_m` of the segment between two points, m.

    A disc is a segment of length 0 with its radius as reach; a wall has reach 0.
    """

    from_m: tuple[float, float]
    to_m: tuple[float, float]
    reach_m: float


@dataclass(frozen=True, slots=True)
class Scenario:
    """Robots, obstacles, limits, and when a run counts as done."""

    name: str
    tolerance_m: float
    duration_s: float
    limits: Limits
    robots: tuple[Robot, ...]
    obstacles: tuple[Obstacle, ...]

    def required_m(self, i: int, j: int) -> float:
        """ρ_ij: the distance that two robots' centres have to keep, m."""
        return self.limits.safety_margin_m + self.robots[i].radius_m + self.robots[j].radius_m

    def required_to_core_m(self, i: int, obstacle: Obstacle) -> float:
        """The distance that a robot's centre has to keep from an obstacle's segment, m."""
        return self.limits.safety_margin_m + self.robots[i].radius_m + obstacle.reach_m


def parse(text: str) -> Scenario:
    """The scenario in `text`; it has passed `clearway`'s own checks."""
    document = tomllib.loads(text)
    limits = document.get("limits", {})
    v_mps = limits.get("v_mps", [0.0, 5.0])
    omega_radps = limits.get("omega_radps", [-1.0, 1.0])
    return Scenario(
        name=document["name"],
        tolerance_m=document.get("tolerance_m", DEFAULT_TOLERANCE_M),
        duration_s=document.get("duration_s", DEFAULT_DURATION_S),
        limits=Limits(*v_mps, *omega_radps, limits.get("safety_margin_m", 0.15)),
        robots=tuple(_robot(entry) for entry in document["robot"]),
        obstacles=tuple(_obstacle(entry) for entry in document.get("obstacle", [])),
    )


def _robot(entry: dict) -> Robot:
    if "foreign_speed_mps" in entry:
        raise ValueError(f"robot {entry['id']} is foreign, and no peer drives beside foreign robots")
    start, goal = entry["start"], entry["goal"]
    x, y, goal_m = start["x_m"], start["y_m"], (goal["x_m"], goal["y_m"])
    theta = start.get("theta_rad")
    if theta is None:
        theta = math.atan2(goal_m[1] - y, goal_m[0] - x)
    return Robot(entry["id"], entry["radius_m"], (x, y, theta), goal_m)


def _obstacle(entry: dict) -> Obstacle:
    if "circle" in entry:
        circle = entry["circle"]
        centre = (circle["x_m"], circle["y_m"])
        return Obstacle(centre, centre, circle["radius_m"])
    segment = entry["segment"]
    return Obstacle(tuple(segment["from_m"]), tuple(segment["to_m"]), 0.0)
