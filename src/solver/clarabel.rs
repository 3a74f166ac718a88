use super::exact::solve_within;
use super::{Outcome, Solver};
use crate::programme::{Certificate, Interval, Programme, Row, Solution};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverError, SolverStatus,
    SupportedConeT,
};
use std::f64::consts::SQRT_2;

/// Rows of each kind that the smaller workspaces hold; the largest holds the programme's capacity.
const SIZES: [usize; 4] = [4, 8, 16, 32];

/// The programme in conic form, solved by Clarabel.
///
/// One workspace for each of a few sizes is built at start with a fixed sparsity; a solve picks the
/// smallest that fits, overwrites its data and iterates. The data are scaled first so that every
/// row and the objective are of order one, whatever the weights and units:
///
/// * v = lo + (hi − lo) v̂ over the part of the admissible interval that can hold the minimiser,
///   likewise ω, so that a blocked robot's programme, where hi = lo, still has an interior;
/// * each row is divided by its largest term, and its slack with it;
/// * a certificate ĉx̂ + ½κ²x̂² + Q̂ ≤ δ̂ is the second-order cone
///   ‖(t̂ − 1, √2 κ x̂)‖ ≤ t̂ + 1 with t̂ = δ̂ − Q̂ − ĉx̂.
///
/// An interior point method that ends at a duality gap ε leaves the inputs within about √ε of a
/// flat optimum. Clarabel's answer therefore only says where the solution is; inside a trust
/// interval around it the last digits and the multipliers come from the optimality conditions in
/// closed form. When they would leave the trust interval, Clarabel's own numbers stay.
///
/// Tens of microseconds a solve. Updating the data does not allocate; Clarabel itself may.
pub struct ClarabelSolver {
    workspaces: Vec<Workspace>,
    polished: Option<Solution>,
}

/// An input that could move by less than this share of its admissible interval stays at 0.
const STILL: f64 = 1e-6;

/// An input that could move by less than this, m/s or rad/s, stays at 0 too: the speed left to a robot
/// that touches another.
const LEAST: f64 = 1e-7;

/// Half-width of the trust interval, as a share of the width that the solve was scaled with.
const TRUST: f64 = 1e-2;

/// Shares of the step to the boundary that are tried in turn. With Clarabel's default of 0.99 the
/// last iterations stall on about one programme in a thousand, with the first of these on one in a
/// hundred thousand.
const STEP_FRACTIONS: [f64; 3] = [0.95, 0.8, 0.5];

impl ClarabelSolver {
    /// Builds the workspaces for programmes of up to `capacity` rows of each kind.
    ///
    /// # Errors
    /// What Clarabel says about the problem that it is built with.
    pub fn new(capacity: usize) -> Result<Self, SolverError> {
        let sizes = SIZES.into_iter().filter(|s| *s < capacity).chain([capacity]);
        let workspaces = sizes.map(Workspace::new).collect::<Result<_, _>>()?;
        Ok(Self { workspaces, polished: Some(Solution::with_capacity(capacity)) })
    }

    /// Builds one workspace only, for programmes of up to `rows` rows of each kind.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of_one_size(rows: usize) -> Result<Self, SolverError> {
        let workspaces = vec![Workspace::new(rows)?];
        Ok(Self { workspaces, polished: Some(Solution::with_capacity(rows)) })
    }

    /// Returns Clarabel's numbers as they are, without the closed-form last digits.
    #[must_use]
    pub fn without_polish(self) -> Self {
        Self { polished: None, ..self }
    }

    /// Iterations of the last solve that used the workspace for `rows` rows.
    pub fn iterations(&self, rows: usize) -> Option<u32> {
        self.workspaces.iter().find(|w| rows <= w.size).map(|w| w.solver.solution.iterations)
    }
}

impl Solver for ClarabelSolver {
    fn solve(&mut self, programme: &Programme, solution: &mut Solution) -> Outcome {
        if !programme.is_well_posed() {
            return Outcome::IllPosed;
        }
        let rows = programme.comfort.len().max(programme.safety.len());
        let Some(workspace) = self.workspaces.iter_mut().find(|w| rows <= w.size) else {
            return Outcome::TooLarge;
        };
        let Some(scales) = workspace.solve(programme) else {
            return Outcome::NotConverged;
        };
        workspace.read(programme, &scales, solution);
        if let Some(polished) = &mut self.polished {
            let (v, omega) = (solution.v_mps, solution.omega_radps);
            if solve_within(programme, polished, scales.v.trust(v), scales.omega.trust(omega)) {
                std::mem::swap(solution, polished);
            }
        }
        Outcome::Solved
    }
}

/// Where things are in the conic form of `size` rows of each kind. Variables: v̂, ω̂, δ̂_p, δ̂_θ, δ̂_r.
#[derive(Debug, Clone, Copy)]
struct Layout {
    size: usize,
}

impl Layout {
    const V: usize = 0;
    const OMEGA: usize = 2;
    const SLACK_POSITION: usize = 4;
    const SLACK_HEADING: usize = 5;
    const SLACK_COMFORT: usize = 6;

    fn variables(self) -> usize {
        4 + self.size
    }
    fn comfort(self) -> usize {
        Self::SLACK_COMFORT + self.size
    }
    fn safety(self) -> usize {
        self.comfort() + self.size
    }
    fn position_cone(self) -> usize {
        self.safety() + self.size
    }
    fn heading_cone(self) -> usize {
        self.position_cone() + 3
    }
    fn rows(self) -> usize {
        self.heading_cone() + 3
    }

    /// Index of the first comfort coefficient among the values of A (column of v̂).
    const VALUE_COMFORT: usize = 2;
    fn value_safety(self) -> usize {
        Self::VALUE_COMFORT + self.size
    }
    fn value_position(self) -> usize {
        self.value_safety() + self.size
    }
    fn value_heading(self) -> usize {
        self.value_position() + 3 + 2
    }

    /// A with its fixed sparsity; coefficients that change from solve to solve are 0.
    fn matrix(self) -> CscMatrix<f64> {
        let (p, h) = (self.position_cone(), self.heading_cone());
        let mut columns: Vec<Vec<(usize, f64)>> = Vec::with_capacity(self.variables());
        let mut v = vec![(Self::V, 1.0), (Self::V + 1, -1.0)];
        v.extend((self.comfort()..p).map(|row| (row, 0.0)));
        v.extend((p..p + 3).map(|row| (row, 0.0)));
        columns.push(v);
        columns.push(vec![(Self::OMEGA, 1.0), (Self::OMEGA + 1, -1.0), (h, 0.0), (h + 1, 0.0), (h + 2, 0.0)]);
        columns.push(vec![(Self::SLACK_POSITION, -1.0), (p, -1.0), (p + 1, -1.0)]);
        columns.push(vec![(Self::SLACK_HEADING, -1.0), (h, -1.0), (h + 1, -1.0)]);
        columns.extend(
            (0..self.size).map(|j| vec![(Self::SLACK_COMFORT + j, -1.0), (self.comfort() + j, -1.0)]),
        );

        let mut starts = vec![0];
        let (mut rows, mut values) = (Vec::new(), Vec::new());
        for column in columns {
            rows.extend(column.iter().map(|(row, _)| *row));
            values.extend(column.iter().map(|(_, value)| *value));
            starts.push(rows.len());
        }
        CscMatrix::new(self.rows(), self.variables(), starts, rows, values)
    }
}

/// One Clarabel solver and the arrays that carry data to it.
struct Workspace {
    size: usize,
    layout: Layout,
    solver: DefaultSolver<f64>,
    p: Vec<f64>,
    q: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
}

/// Scales that undo the scaling of one solve.
#[derive(Clone, Copy)]
struct Scales {
    v: Axis,
    omega: Axis,
    position: Slack,
    heading: Slack,
    objective_v: f64,
    objective_omega: f64,
}

/// δ = offset + scale·δ̂.
#[derive(Clone, Copy)]
struct Slack {
    offset: f64,
    scale: f64,
}

/// x = lo + width·x̂.
#[derive(Clone, Copy)]
struct Axis {
    lo: f64,
    width: f64,
    /// A width below this counts as 0.
    still: f64,
}

impl Axis {
    /// The part of `interval` between 0 and the vertex of the certificate. The minimiser is there:
    /// every row holds at 0, and beyond the vertex all terms of the objective grow.
    fn over(interval: Interval, certificate: Certificate) -> Self {
        let vertex = if certificate.curvature > 0.0 {
            -certificate.linear / certificate.curvature
        } else {
            f64::INFINITY.copysign(-certificate.linear)
        };
        let lo = interval.min.max(vertex.min(0.0));
        let hi = interval.max.min(vertex.max(0.0));
        // A way to go that vanishes beside what the input could do is rounding.
        let still = (STILL * (interval.max - interval.min)).max(LEAST);
        if hi - lo <= still {
            return Self { lo: 0.0f64.clamp(lo, hi.max(lo)), width: 0.0, still };
        }
        Self { lo, width: hi - lo, still }
    }

    /// Where the solution is looked for, given Clarabel's x.
    fn trust(self, x: f64) -> Interval {
        let half = (TRUST * self.width).max(self.still);
        Interval { min: x - half, max: x + half }
    }

    /// The certificate in x̂.
    fn certificate(self, c: Certificate) -> Certificate {
        Certificate {
            linear: c.slope(self.lo) * self.width,
            curvature: c.curvature * self.width * self.width,
            decrease: c.excess(self.lo),
        }
    }

    /// The row in x̂, divided by its largest term, and that term; `None` when it holds for every x̂
    /// in [0, 1].
    fn row(self, row: Row) -> Option<(Row, f64)> {
        let (coefficient, bound) = (row.coefficient * self.width, row.bound - row.coefficient * self.lo);
        if coefficient.max(0.0) <= bound {
            return None;
        }
        let scale = or_one(coefficient.abs().max(bound.abs()));
        Some((Row { coefficient: coefficient / scale, bound: bound / scale }, scale))
    }
}
/// A place without a row, 0·x̂ ≤ 1, and the scale of its slack.
const NO_ROW: (Row, f64) = (Row { coefficient: 0.0, bound: 1.0 }, 0.0);

/// 1 where a scale would be 0.
fn or_one(scale: f64) -> f64 {
    if scale > 0.0 { scale } else { 1.0 }
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
    fn new(size: usize) -> Result<Self, SolverError> {
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
    fn solve(&mut self, programme: &Programme) -> Option<Scales> {
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

    fn solved(&self) -> bool {
        self.solver.solution.status == SolverStatus::Solved
    }

    /// Writes the scaled data.
    fn fill(&mut self, programme: &Programme) -> Scales {
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
    fn cone(&mut self, c: Certificate, row: usize, value: usize) -> Slack {
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
    fn read(&self, programme: &Programme, scales: &Scales, solution: &mut Solution) {
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
