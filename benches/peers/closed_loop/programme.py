"""The paper's programme and the corrected one by the paper's tool chain: CasADi and IPOPT.

One solver is built for every number of rows, before the clock starts; a solve sets parameters and
calls it, from u = 0. What is timed is that call. A robot inside the tolerance of its goal holds and
solves nothing, and one whose solve fails stops for the period; both as in `clearway`.
"""

from collections.abc import Sequence

import casadi as ca

import ipopt

from . import certificates
from .law import Pose, Times
from .motion import Motion
from .scenario import Scenario


class Programme:
    """A fleet of which every robot solves its own programme, one after the other on one core."""

    holonomic, memoryless = False, True

    def __init__(self, scenario: Scenario, period_s: float) -> None:
        self.scenario, self.period_s = scenario, period_s
        self.times, self.not_solved = Times(), 0
        self.last_v_mps = [0.0] * len(scenario.robots)
        self.solvers: dict[tuple[int, ...], object] = {}

    def decide(self, poses: Sequence[Pose]) -> list[Motion]:
        """Everybody's motion for the period."""
        before = len(self.times.solve_ns)
        motions = []
        for i, (robot, p) in enumerate(zip(self.scenario.robots, poses, strict=True)):
            distance, _, _ = certificates.goal_errors(p, robot.goal_m)
            holds = distance <= self.scenario.tolerance_m
            v, omega = (0.0, 0.0) if holds else self._input(i, list(poses))
            motions.append(Motion(*p, v, omega))
        self.last_v_mps = [m.v_mps for m in motions]
        self.times.fleet_step_ns.append(sum(self.times.solve_ns[before:]))
        return motions

    def _input(self, me: int, poses: list[Pose]) -> tuple[float, float]:
        raise NotImplementedError

    def _solve(self, solver: ca.Function, arguments: dict) -> tuple[float, float]:
        """(v, ω) inside their limits; a stop when IPOPT gives up."""
        result = self.times.timed(lambda: solver(**arguments))
        if not solver.stats()["success"]:
            self.not_solved += 1
            return 0.0, 0.0
        limits, (v, omega) = self.scenario.limits, (float(result["x"][0]), float(result["x"][1]))
        v = min(max(v, limits.v_min_mps), limits.v_max_mps)
        return v, min(max(omega, limits.omega_min_radps), limits.omega_max_radps)


class PrintedProgramme(Programme):
    """(33) with its reverse-convex rows and tightening slacks."""

    def __init__(self, scenario: Scenario, period_s: float, q_sign: float) -> None:
        """`q_sign`: −1 for Q as printed below (33), +1 for the sign of Definition 2."""
        if scenario.obstacles:
            raise ValueError("the paper's programme has no row for an obstacle")
        super().__init__(scenario, period_s)
        self.q_sign = q_sign

    def _input(self, me: int, poses: list[Pose]) -> tuple[float, float]:
        goal, limits = self.scenario.robots[me].goal_m, self.scenario.limits
        position, heading = certificates.printed(poses[me], goal, self.period_s, self.q_sign)
        rows = certificates.printed_rows(self.scenario, me, poses, self.last_v_mps, self.period_s)
        key = (len(rows),)
        if key not in self.solvers:
            self.solvers[key] = printed_solver(len(rows), self.period_s)
        parameters = [*position.as_dict().values(), *heading.as_dict().values()]
        slacks = [0.0] * (2 + len(rows))
        arguments = {
            "x0": 0.0,
            "p": [*parameters, *(number for row in rows for number in row)],
            "lbx": [limits.v_min_mps, limits.omega_min_radps, *slacks],
            "ubx": [limits.v_max_mps, limits.omega_max_radps, *(ca.inf for _ in slacks)],
            "lbg": -ca.inf,
            "ubg": 0.0,
        }
        return self._solve(self.solvers[key], arguments)


def printed_solver(rows: int, period_s: float) -> ca.Function:
    """IPOPT on (33) with `rows` neighbours; (33d) reads δ_r − T²v² − a·v − b ≤ 0."""
    w = certificates.WEIGHTS
    u, slack = ca.SX.sym("u", 2), ca.SX.sym("slack", 2 + rows)
    position, heading = ca.SX.sym("position", 3), ca.SX.sym("heading", 3)
    barrier = ca.SX.sym("barrier", 2 * rows)
    v, omega = u[0], u[1]
    objective = 0.5 * (w["v"] * v**2 + w["omega"] * omega**2)
    objective += w["position"] * slack[0] + w["heading"] * slack[1] + w["comfort"] * ca.sum1(slack[2:])
    constraints = [ipopt.excess(position, v) - slack[0], ipopt.excess(heading, omega) - slack[1]]
    constraints += [
        slack[2 + j] - (period_s * v) ** 2 - barrier[2 * j] * v - barrier[2 * j + 1] for j in range(rows)
    ]
    nlp = {
        "x": ca.vertcat(u, slack),
        "p": ca.vertcat(position, heading, barrier),
        "f": objective,
        "g": ca.vertcat(*constraints),
    }
    return ca.nlpsol("printed", "ipopt", nlp, ipopt.OPTIONS)


class CorrectedProgramme(Programme):
    """`clearway`'s own programme without its guidance: hard rows in form F2, comfort rows, Q_sat."""

    def _input(self, me: int, poses: list[Pose]) -> tuple[float, float]:
        goal, limits = self.scenario.robots[me].goal_m, self.scenario.limits
        position, heading = certificates.corrected(poses[me], goal, self.period_s, limits)
        hard, comfort = certificates.corrected_rows(self.scenario, me, poses, self.period_s)
        key = len(comfort), len(hard)
        if key not in self.solvers:
            self.solvers[key] = ipopt.Model(certificates.WEIGHTS, *key)
        model = self.solvers[key]
        problem = {
            "position": position.as_dict(),
            "heading": heading.as_dict(),
            "comfort": comfort,
            "safety": hard,
            "v_mps": (limits.v_min_mps, limits.v_max_mps),
            "omega_radps": (limits.omega_min_radps, limits.omega_max_radps),
        }
        v, omega = self._solve(model.solver, model.arguments(problem))
        # An interior point may stand on the wrong side of a row by its tolerance.
        return certificates.speed_limit_mps(hard, v), omega
