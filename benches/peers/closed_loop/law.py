"""What a control law is to the loop, and the loop: exact plant, one period after the other.

A command acts at the instant of the state that it was computed from, with no time lost for computing
it (`clearway eval --timing ideal`). Our own runs keep the daemon's timing, where a command acts one
period later: the loop favours the peers by that period.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from .figures import Evaluator, Figures
from .motion import Motion, pose
from .scenario import Scenario

Pose = tuple[float, float, float]

# Everybody has stayed inside the tolerance for this long, s: the run is over.
STAY_S = 1.0
# Inputs may exceed a limit by this much, in m/s or rad/s: rounding.
ROUNDING = 1e-9
# A memoryless law that has moved nobody by more than this in so long will never move anybody again.
STANDING_M, STANDING_RAD, STANDING_S = 5e-3, 5e-3, 5.0


@dataclass(slots=True)
class Times:
    """What the peer's own code took, ns; what Python does around it is left out."""

    solve_ns: list[int] = field(default_factory=list)
    fleet_step_ns: list[int] = field(default_factory=list)

    def timed(self, call: Callable[[], object]) -> object:
        """`call`'s answer; its time counts as one solve."""
        started = time.perf_counter_ns()
        answer = call()
        self.solve_ns.append(time.perf_counter_ns() - started)
        return answer


class Law(Protocol):
    """One run of one peer in one scenario."""

    # Robots move in any direction and have no heading of their own.
    holonomic: bool
    # The inputs depend on poses and inputs alone, so that a fleet that stands stays.
    memoryless: bool
    # Solves that ended without a solution.
    not_solved: int
    times: Times

    def decide(self, poses: Sequence[Pose]) -> list[Motion]:
        """The motions that start at `poses` and are held for a period."""
        ...


@dataclass(frozen=True, slots=True)
class Outcome:
    """A finished run."""

    figures: Figures
    ended_by: str
    times: Times
    not_solved: int


class LimitError(Exception):
    """A law asked for what the robots cannot do, which is a defect of its adapter."""


def run(scenario: Scenario, law: Law, period_s: float) -> Outcome:
    """Drives `scenario` with `law` until everybody has arrived and stayed, or its time is up."""
    evaluator = Evaluator(scenario, period_s, law.holonomic)
    poses: list[Pose] = [robot.start for robot in scenario.robots]
    stay, standing = math.ceil(STAY_S / period_s), math.ceil(STANDING_S / period_s)
    stayed, ended_by = 0, "time"
    since_tick, since_poses = 0, poses
    for tick in range(math.ceil(scenario.duration_s / period_s)):
        fleet = law.decide(poses)
        check(scenario, law, poses, fleet)
        evaluator.observe(tick, fleet)
        stayed = stayed + 1 if evaluator.all_arrived else 0
        if stayed > stay:
            ended_by = "arrival"
            break
        poses = [pose(m, period_s) for m in fleet]
        if any(_moved(p, q) for p, q in zip(poses, since_poses, strict=True)):
            since_tick, since_poses = tick, poses
        elif law.memoryless and tick - since_tick >= standing:
            ended_by = "standstill"
            break
    return Outcome(evaluator.finish(), ended_by, law.times, law.not_solved)


def _moved(p: Pose, q: Pose) -> bool:
    turned = abs(math.remainder(p[2] - q[2], math.tau))
    return math.hypot(p[0] - q[0], p[1] - q[1]) > STANDING_M or turned > STANDING_RAD


def check(scenario: Scenario, law: Law, poses: Sequence[Pose], fleet: Sequence[Motion]) -> None:
    """That every motion starts where its robot is and keeps to the limits of its inputs."""
    limits = scenario.limits
    for robot, p, m in zip(scenario.robots, poses, fleet, strict=True):
        here = (m.x_m, m.y_m) == p[:2] and (law.holonomic or m.theta_rad == p[2])
        lowest = 0.0 if law.holonomic else limits.v_min_mps
        v_fits = lowest - ROUNDING <= m.v_mps <= limits.v_max_mps + ROUNDING
        omega_fits = limits.omega_min_radps - ROUNDING <= m.omega_radps <= limits.omega_max_radps + ROUNDING
        if not (here and v_fits and omega_fits):
            raise LimitError(f"robot {robot.id} at {p} was given {m}")
