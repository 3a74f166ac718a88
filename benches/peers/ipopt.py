#!/usr/bin/env python3
"""The programmes of `clearway bench solve --export FILE` through CasADi and IPOPT.

For every number of neighbours one solver is built once, with the data as parameters (`warm`), and
one is built anew for every problem (`cold`). Both are asked for the same optimum as Clearway's
exact solver, whose answers stand in the file.
"""

import argparse
import json
import sys
import time

import casadi as ca
import numpy as np

OPTIONS = {
    "print_time": False,
    "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8},
}


class Model:
    """One robot's programme with `comfort` rows with slack and `safety` rows without."""

    def __init__(self, weights: dict, comfort: int, safety: int) -> None:
        self.comfort, self.safety = comfort, safety
        u = ca.SX.sym("u", 2)
        slack = ca.SX.sym("slack", 2 + comfort)
        position, heading = ca.SX.sym("position", 3), ca.SX.sym("heading", 3)
        soft, hard = ca.SX.sym("soft", 2 * comfort), ca.SX.sym("hard", 2 * safety)
        v, omega = u[0], u[1]

        objective = 0.5 * (weights["v"] * v**2 + weights["omega"] * omega**2)
        objective += weights["position"] * slack[0] + weights["heading"] * slack[1]
        objective += weights["comfort"] * ca.sum1(slack[2:])
        rows = [
            excess(position, v) - slack[0],
            excess(heading, omega) - slack[1],
        ]
        rows += [soft[2 * j] * v - soft[2 * j + 1] - slack[2 + j] for j in range(comfort)]
        rows += [hard[2 * j] * v - hard[2 * j + 1] for j in range(safety)]
        nlp = {
            "x": ca.vertcat(u, slack),
            "p": ca.vertcat(position, heading, soft, hard),
            "f": objective,
            "g": ca.vertcat(*rows),
        }
        self.solver = ca.nlpsol("programme", "ipopt", nlp, OPTIONS)

    def arguments(self, problem: dict) -> dict:
        """What a problem changes: parameters, bounds and the start u = 0."""
        parameters = []
        for name in ("position", "heading"):
            c = problem[name]
            parameters += [c["linear"], c["curvature"], c["decrease"]]
        for row in problem["comfort"] + problem["safety"]:
            parameters += row
        (v_min, v_max), (omega_min, omega_max) = problem["v_mps"], problem["omega_radps"]
        slacks = 2 + self.comfort
        return {
            "x0": 0.0,
            "p": parameters,
            "lbx": [v_min, omega_min] + [0.0] * slacks,
            "ubx": [v_max, omega_max] + [np.inf] * slacks,
            "lbg": -np.inf,
            "ubg": 0.0,
        }


def excess(certificate: ca.SX, x: ca.SX) -> ca.SX:
    """linear·x + ½ curvature·x² + decrease."""
    return certificate[0] * x + 0.5 * certificate[1] * x**2 + certificate[2]


def objective(weights: dict, problem: dict, v: float, omega: float) -> float:
    """The objective at (v, ω) with the smallest slacks, as Clearway computes it."""

    def over(c: dict, x: float) -> float:
        return max(0.0, c["linear"] * x + 0.5 * c["curvature"] * x * x + c["decrease"])

    value = 0.5 * (weights["v"] * v * v + weights["omega"] * omega * omega)
    value += weights["position"] * over(problem["position"], v)
    value += weights["heading"] * over(problem["heading"], omega)
    return value + weights["comfort"] * sum(max(0.0, a * v - b) for a, b in problem["comfort"])


def quantiles(ns: list[int]) -> dict[str, int]:
    """Nearest-rank quantiles, ns."""
    ordered = sorted(ns)

    def at(per_mille: int) -> int:
        return ordered[max(-(-len(ordered) * per_mille // 1000) - 1, 0)]

    return {"p50": at(500), "p99": at(990), "p999": at(999), "max": ordered[-1]}


def spread(items: list, count: int) -> list:
    """At most `count` of `items`, evenly spaced."""
    if len(items) <= count:
        return items
    return [items[k * len(items) // count] for k in range(count)]


def measure(case: dict, weights: dict, samples: int, cold_samples: int) -> dict:
    """Times and disagreement for one number of neighbours."""
    problems = spread(case["problems"], samples)
    models, warm, cold = {}, [], []
    gaps = {"max_objective_gap_rel": 0.0, "max_input_gap": 0.0}
    not_solved = 0

    def model_for(problem: dict) -> Model:
        size = len(problem["comfort"]), len(problem["safety"])
        if size not in models:
            models[size] = Model(weights, *size)
            models[size].solver(**models[size].arguments(problem))
        return models[size]

    for problem in problems:
        model = model_for(problem)
        arguments = model.arguments(problem)
        started = time.perf_counter_ns()
        result = model.solver(**arguments)
        warm.append(time.perf_counter_ns() - started)
        if not model.solver.stats()["success"]:
            not_solved += 1
            continue
        v, omega = (float(x) for x in np.asarray(result["x"]).ravel()[:2])
        exact = problem["exact"]
        gap = abs(objective(weights, problem, v, omega) - exact["objective"])
        gap /= 1.0 + abs(exact["objective"])
        inputs = max(abs(v - exact["v_mps"]), abs(omega - exact["omega_radps"]))
        gaps["max_objective_gap_rel"] = max(gaps["max_objective_gap_rel"], gap)
        gaps["max_input_gap"] = max(gaps["max_input_gap"], inputs)

    for problem in spread(problems, cold_samples):
        started = time.perf_counter_ns()
        model = Model(weights, len(problem["comfort"]), len(problem["safety"]))
        model.solver(**model.arguments(problem))
        cold.append(time.perf_counter_ns() - started)

    return {
        "neighbours": case["neighbours"],
        "samples": len(problems),
        "not_solved": not_solved,
        "ipopt_ns": quantiles(warm),
        "ipopt_cold_ns": quantiles(cold),
        "cold_samples": len(cold),
        **gaps,
    }


def table(results: list[dict]) -> str:
    """The results as text."""
    lines = [
        f"{'neighbours':>10} {'samples':>8} {'p50 ms':>8} {'p99':>8} {'p99.9':>8} {'max':>8}"
        f" {'anew p50':>9} {'objective gap':>14} {'input gap':>10} {'not solved':>11}"
    ]
    for r in results:
        times = " ".join(f"{r['ipopt_ns'][q] / 1e6:8.2f}" for q in ("p50", "p99", "p999", "max"))
        lines.append(
            f"{r['neighbours']:>10} {r['samples']:>8} {times} {r['ipopt_cold_ns']['p50'] / 1e6:9.2f}"
            f" {r['max_objective_gap_rel']:14.0e} {r['max_input_gap']:10.0e} {r['not_solved']:>11}"
        )
    return "\n".join(lines)


def main() -> None:
    """Measures the problems of a file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", help="what `clearway bench solve --export` wrote")
    parser.add_argument("--samples", type=int, default=1000, help="problems a case, at most (%(default)s)")
    parser.add_argument("--cold-samples", type=int, default=100, help="solvers built anew (%(default)s)")
    parser.add_argument("--json", metavar="OUT", help="write the results; - for standard output")
    args = parser.parse_args()
    if args.samples < 1 or args.cold_samples < 1:
        parser.error("samples are counted from 1")

    with open(args.problems, encoding="utf-8") as file:
        document = json.load(file)
    results = []
    for case in document["cases"]:
        if case["problems"]:
            print(f"{case['neighbours']} neighbours", file=sys.stderr)
            results.append(measure(case, document["weights"], args.samples, args.cold_samples))
    report = json.dumps({"casadi": ca.__version__, "cases": results}, indent=2)
    if args.json == "-":
        print(report)
        return
    if args.json:
        with open(args.json, "w", encoding="utf-8") as file:
            file.write(report + "\n")
    print(f"CasADi {ca.__version__} with IPOPT, times in ms\n")
    print(table(results))


if __name__ == "__main__":
    main()
