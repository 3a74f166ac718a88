//! The problems as JSON, for solvers outside of this program.

use super::problems::Group;
use clearway::programme::{Certificate, Interval, Programme, Row, Solution};
use clearway::solver::{ExactSolver, Solver};
use serde_json::{Value, json};

fn certificate(c: &Certificate) -> Value {
    json!({ "linear": c.linear, "curvature": c.curvature, "decrease": c.decrease })
}

fn interval(i: Interval) -> Value {
    json!([i.min, i.max])
}

fn rows(rows: &[Row]) -> Vec<[f64; 2]> {
    rows.iter().map(|r| [r.coefficient, r.bound]).collect()
}

/// One problem with the exact solver's answer.
fn problem(programme: &Programme, solution: &mut Solution) -> Value {
    ExactSolver.solve(programme, solution);
    let (v, omega) = (solution.v_mps, solution.omega_radps);
    json!({
        "position": certificate(&programme.position),
        "heading": certificate(&programme.heading),
        "v_mps": interval(programme.v_mps),
        "omega_radps": interval(programme.omega_radps),
        "comfort": rows(&programme.comfort),
        "safety": rows(&programme.safety),
        "exact": { "v_mps": v, "omega_radps": omega, "objective": programme.objective(v, omega) },
    })
}

/// Everything that was measured, as `{weights, cases: [{neighbours, problems}]}`.
pub(super) fn document(groups: &[Group], capacity: usize) -> Value {
    let mut solution = Solution::with_capacity(capacity);
    let weights = groups.iter().find_map(|g| g.problems.first()).map(|p| {
        let w = &p.weights;
        json!({ "v": w.v, "omega": w.omega, "position": w.position, "heading": w.heading, "comfort": w.comfort })
    });
    let cases: Vec<Value> = groups
        .iter()
        .map(|group| {
            let problems: Vec<Value> = group.problems.iter().map(|p| problem(p, &mut solution)).collect();
            json!({ "neighbours": group.neighbours, "problems": problems })
        })
        .collect();
    json!({ "weights": weights, "cases": cases })
}
