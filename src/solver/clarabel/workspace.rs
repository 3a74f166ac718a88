//! One Clarabel solver with a fixed sparsity, and the arrays that carry data to it.

use super::layout::Layout;
use super::scaling::{Axis, NO_ROW, Scales, Slack, or_one};
use crate::programme::{Certificate, Interval, Programme, Row, Solution};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverError, SolverStatus,
    SupportedConeT,
};
use std::f64::consts::SQRT_2;

/// Shares of the step to the boundary that are tried in turn. With Clarabel's default of 0.99 the
/// last iterations stall on about one programme in a thousand, with the first of these on one in a
/// hundred thousand.
const STEP_FRACTIONS: [f64; 3] = [0.95, 0.8, 0.5];

/// One Clarabel solver and the arrays that carry data to it.
pub(super) struct Workspace {
    pub(super) size: usize,
    pub(super) layout: Layout,
    pub(super) solver: DefaultSolver<f64>,
    pub(super) p: Vec<f64>,
    pub(super) q: Vec<f64>,
    pub(super) a: Vec<f64>,
    pub(super) b: Vec<f64>,
}

fn settings(step_fraction: f64) -> DefaultSettings<f64> {
    let built = DefaultSettingsBuilder::default()
        .verbose(false)
        .max_iter(60)
        // The data come scaled; the equilibration would be that of the first data for ever.
        .equilibrate_enable(false)
        .presolve_enable(false)
        .tol_gap_abs(1e-10)
        .tol_gap_rel(1e-10)
        .tol_feas(1e-8)
        .max_step_fraction(step_fraction)
        .max_threads(1)
        .direct_solve_method("qdldl".to_owned())
        .build();
    // The builder only refuses unknown method names; the defaults are a sound second choice.
    built.unwrap_or_default()
}

impl Workspace {
    pub(super) fn new(size: usize) -> Result<Self, SolverError> {
        let layout = Layout { size };
        let n = layout.variables();
        let p = CscMatrix::new(n, n, [vec![0, 1], vec![2; n - 1]].concat(), vec![0, 1], vec![1.0, 1.0]);
        let a = layout.matrix();
        let (q, b) = (vec![1.0; n], vec![1.0; layout.rows()]);
        let cones = [
            SupportedConeT::NonnegativeConeT(layout.position_cone()),
            SupportedConeT::SecondOrderConeT(3),
            SupportedConeT::SecondOrderConeT(3),
        ];
        let solver = DefaultSolver::new(&p, &q, &a, &b, &cones, settings(STEP_FRACTIONS[0]))?;
        Ok(Self { size, layout, solver, p: p.nzval, q, a: a.nzval, b })
    }

    /// Runs Clarabel; `None` unless it ends Solved.
    pub(super) fn solve(&mut self, programme: &Programme) -> Option<Scales> {
        let scales = self.fill(programme);
        self.solver.update_data(&self.p, &self.q, &self.a, &self.b).ok()?;
        self.solver.solve();
        for fraction in &STEP_FRACTIONS[1..] {
            if self.solved() {
                break;
            }
            self.solver.update_settings(settings(*fraction)).ok()?;
            self.solver.solve();
            // The next programme starts from the same settings as this one.
            self.solver.update_settings(settings(STEP_FRACTIONS[0])).ok()?;
        }
        self.solved().then_some(scales)
    }

    pub(super) fn solved(&self) -> bool {
        self.solver.solution.status == SolverStatus::Solved
    }

    /// Writes the scaled data.
    pub(super) fn fill(&mut self, programme: &Programme) -> Scales {
        let layout = self.layout;
        let w = &programme.weights;
        let v = Axis::over(programme.admissible_v(), programme.position);
        let omega = Axis::over(programme.omega_radps, programme.heading);
        let position = v.certificate(programme.position);
        let heading = omega.certificate(programme.heading);

        self.b.fill(0.0);
        let position_slack = self.cone(position, layout.position_cone(), layout.value_position());
        let heading_slack = self.cone(heading, layout.heading_cone(), layout.value_heading());

        let bound = |interval: Interval, axis: Axis| {
            let scale = or_one(axis.width);
            [(interval.max - axis.lo) / scale, (axis.lo - interval.min) / scale]
        };
        self.b[Layout::V..Layout::V + 2].copy_from_slice(&bound(programme.v_mps, v));
        self.b[Layout::OMEGA..Layout::OMEGA + 2].copy_from_slice(&bound(programme.omega_radps, omega));

        for k in 0..self.size {
            let row = |rows: &[Row]| rows.get(k).and_then(|row| v.row(*row)).unwrap_or(NO_ROW);
            let (comfort, scale) = row(&programme.comfort);
            self.a[Layout::VALUE_COMFORT + k] = comfort.coefficient;
            self.b[layout.comfort() + k] = comfort.bound;
            self.q[4 + k] = w.comfort * scale;
            let (safety, _) = row(&programme.safety);
            self.a[layout.value_safety() + k] = safety.coefficient;
            self.b[layout.safety() + k] = safety.bound;
        }
        (self.p[0], self.q[0]) = (w.v * v.width * v.width, w.v * v.lo * v.width);
        (self.p[1], self.q[1]) = (w.omega * omega.width * omega.width, w.omega * omega.lo * omega.width);
        self.q[2] = w.position * position_slack.scale;
        self.q[3] = w.heading * heading_slack.scale;

        // The programme separates into its part in v and its part in ω, so each may have a scale of
        // its own: neither then drowns in the other's weights.
        let largest = |values: &[f64]| or_one(values.iter().fold(0.0f64, |m, x| m.max(x.abs())));
        let comfort = self.q[4..].iter().fold(0.0f64, |m, q| m.max(*q));
        let objective_v = largest(&[self.p[0], self.q[0], self.q[2], comfort]);
        let objective_omega = largest(&[self.p[1], self.q[1], self.q[3]]);
        let mut divide = |k: usize, by: f64| self.q[k] /= by;
        for k in [0, 2].into_iter().chain(4..4 + self.size) {
            divide(k, objective_v);
        }
        divide(1, objective_omega);
        divide(3, objective_omega);
        self.p[0] /= objective_v;
        self.p[1] /= objective_omega;
        // What has no effect is held down, so that the scaled problem has one solution: the slack of
        // a place without a row or of a vanishing certificate, and an input that cannot move.
        self.q[2..].iter_mut().filter(|q| **q == 0.0).for_each(|q| *q = 1.0);
        if v.width == 0.0 {
            self.q[0] = 1.0;
        }
        if omega.width == 0.0 {
            self.q[1] = 1.0;
        }
        Scales { v, omega, position: position_slack, heading: heading_slack, objective_v, objective_omega }
    }

    /// Writes a certificate as a cone; returns how to read its slack.
    ///
    /// The slack that no x̂ in [0, 1] can avoid is taken out, so that the scale is that of what the
    /// solver can change.
    pub(super) fn cone(&mut self, c: Certificate, row: usize, value: usize) -> Slack {
        let rise = c.linear + 0.5 * c.curvature;
        // Below its offset the certificate starts at −rise or at 0: their difference would cancel.
        let (offset, decrease) = match (c.decrease, c.decrease + rise) {
            (at_0, at_1) if at_0.min(at_1) <= 0.0 => (0.0, at_0),
            (at_0, at_1) if at_0 <= at_1 => (at_0, 0.0),
            (_, at_1) => (at_1, -rise),
        };
        let scale = c.linear.abs().max(0.5 * c.curvature).max(decrease.abs());
        let per = or_one(scale);
        let (linear, decrease) = (c.linear / per, decrease / per);
        self.a[value] = linear;
        self.a[value + 1] = linear;
        self.a[value + 2] = -SQRT_2 * (c.curvature / per).sqrt();
        self.b[row] = 1.0 - decrease;
        self.b[row + 1] = -1.0 - decrease;
        Slack { offset, scale }
    }

    /// Undoes the scaling.
    pub(super) fn read(&self, programme: &Programme, scales: &Scales, solution: &mut Solution) {
        let layout = self.layout;
        let (x, z) = (&self.solver.solution.x, &self.solver.solution.z);
        let per_v = |scale: f64| scales.objective_v / or_one(scale);
        let per_omega = |scale: f64| scales.objective_omega / or_one(scale);
        solution.reset(programme.comfort.len(), programme.safety.len());
        solution.v_mps = scales.v.lo + scales.v.width * x[0];
        solution.omega_radps = scales.omega.lo + scales.omega.width * x[1];
        solution.slack_position = scales.position.offset + scales.position.scale * x[2];
        solution.slack_heading = scales.heading.offset + scales.heading.scale * x[3];
        let cone = |row: usize| z[row] + z[row + 1];
        solution.dual_position = per_v(scales.position.scale) * cone(layout.position_cone());
        solution.dual_heading = per_omega(scales.heading.scale) * cone(layout.heading_cone());
        for (k, row) in programme.comfort.iter().enumerate() {
            if let Some((_, scale)) = scales.v.row(*row) {
                solution.slack_comfort[k] = scale * x[4 + k];
                solution.dual_comfort[k] = per_v(scale) * z[layout.comfort() + k];
            }
        }
        for (k, row) in programme.safety.iter().enumerate() {
            if let Some((_, scale)) = scales.v.row(*row) {
                solution.dual_safety[k] = per_v(scale) * z[layout.safety() + k];
            }
        }
        let bounds = |row: usize, force: f64| [force * z[row + 1], force * z[row]];
        solution.dual_v = bounds(Layout::V, per_v(scales.v.width));
        solution.dual_omega = bounds(Layout::OMEGA, per_omega(scales.omega.width));
    }
}
