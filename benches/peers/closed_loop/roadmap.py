"""Ways around obstacles for peers that steer towards a point in sight.

ORCA follows a preferred velocity and finds no way around a wall by itself; RVO2's own examples give
it a road map of way points and let every robot head for the one in sight with the shortest rest of
the way (`examples/Roadmap.cpp`). This is that, with way points around every end of a wall and around
every pillar.
"""

import heapq
import math

from .motion import segment_distance
from .scenario import Obstacle, Scenario

Point = tuple[float, float]

# Way points around one end of an obstacle.
CORNERS = 8
# Way points stand this much further out than the distance to keep, m. Who is this close to one has
# passed it, and sees the next one around the same end.
CLEAR_M = 0.05


class Roadmap:
    """Shortest ways to every robot's goal, over way points in sight of each other."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.required_m = [
            max((scenario.required_to_core_m(i, o) for i in range(len(scenario.robots))), default=0.0)
            for o in scenario.obstacles
        ]
        self.points = [
            p for o, r in zip(scenario.obstacles, self.required_m, strict=True) for p in _around(o, r)
        ]
        self.points = [p for p in self.points if self.sees(p, p)]
        # What is left of the way from every way point, for every robot's goal, m.
        self.rest_m = [self._rest(robot.goal_m) for robot in scenario.robots] if self.points else []

    def sees(self, p: Point, q: Point) -> bool:
        """Nothing is in the way of a robot that drives straight from p to q."""
        pairs = zip(self.scenario.obstacles, self.required_m, strict=True)
        return all(segment_distance(p, q, o.from_m, o.to_m) >= r for o, r in pairs)

    def target(self, robot: int, here: Point) -> Point:
        """Where to head for now: the goal, or a way point in sight."""
        goal = self.scenario.robots[robot].goal_m
        if not self.points or self.sees(here, goal):
            return goal
        candidates = sorted(
            (math.dist(here, p) + rest, p)
            for p, rest in zip(self.points, self.rest_m[robot], strict=True)
            if math.isfinite(rest) and math.dist(here, p) >= CLEAR_M
        )
        # From inside the distance to keep nothing is in sight: take the shortest way as it is.
        hidden = candidates[0][1] if candidates else goal
        return next((p for _, p in candidates if self.sees(here, p)), hidden)

    def _rest(self, goal: Point) -> list[float]:
        """Dijkstra from the goal."""
        rest = [math.inf] * len(self.points)
        queue = [(math.dist(p, goal), k) for k, p in enumerate(self.points) if self.sees(p, goal)]
        heapq.heapify(queue)
        while queue:
            length, k = heapq.heappop(queue)
            if length >= rest[k]:
                continue
            rest[k] = length
            for other, p in enumerate(self.points):
                further = length + math.dist(p, self.points[k])
                if further < rest[other] and self.sees(p, self.points[k]):
                    heapq.heappush(queue, (further, other))
        return rest


def _around(obstacle: Obstacle, required_m: float) -> list[Point]:
    # The polygon of way points encloses the disc that has to be kept clear.
    out = (required_m + CLEAR_M) / math.cos(math.pi / CORNERS)
    ends = {obstacle.from_m, obstacle.to_m}
    angles = [math.tau * (k + 0.5) / CORNERS for k in range(CORNERS)]
    return [(x + out * math.cos(a), y + out * math.sin(a)) for x, y in sorted(ends) for a in angles]
