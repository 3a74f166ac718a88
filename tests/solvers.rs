//! One conformance suite, run against every solver.

use clearway::config::{Config, Weights};
use clearway::controller::{RobotGroup, Timing};
use clearway::evaluation;
use clearway::programme::{Certificate, Interval, Programme, Row, Solution};
use clearway::scenario::Scenario;
use clearway::solver::{ClarabelSolver, ExactSolver, Outcome, Solver};
use clearway::verify::Residuals;

const CAPACITY: usize = 16;
const LARGE: usize = 128;

/// SplitMix64: the draws are the same on every machine.
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
    fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }
    fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }
}

/// A programme as the controller builds them, with the degenerate ones over-represented.
fn random_programme(draw: &mut Draw) -> Programme {
    let t = 0.08;
    let mut p = Programme::with_capacity(Weights::default(), CAPACITY);
    let d = if draw.chance(0.1) { 0.0 } else { 10f64.powf(draw.between(-3.0, 1.5)) };
    let align = if draw.chance(0.3) { 1.0 } else { draw.between(-1.0, 1.0) };
    let v = 0.5 * d * d;
    let q = if draw.chance(0.2) { v } else { draw.unit() * v };
    p.position = Certificate { linear: -t * d * align, curvature: t * t, decrease: q };
    let e = if draw.chance(0.1) { 0.0 } else { draw.between(-3.1, 3.1) };
    let h = (e.abs() - t).max(0.0).cos().max(0.0);
    p.heading =
        Certificate { linear: t * e.sin(), curvature: t * t * h, decrease: draw.unit() * (1.0 - e.cos()) };
    let cap = if draw.chance(0.05) { 0.0 } else { draw.between(0.0, 5.0) };
    let reverse = if draw.chance(0.2) { -draw.between(0.0, 2.0) } else { 0.0 };
    p.v_mps = Interval { min: reverse, max: if draw.chance(0.5) { 5.0 } else { cap } };
    p.omega_radps = Interval { min: -1.0, max: 1.0 };
    let rows = draw.next() % 12;
    let (mut last, mut first) = (Row::default(), true);
    for _ in 0..rows {
        let gap = if draw.chance(0.05) { 0.0 } else { 10f64.powf(draw.between(-4.0, 0.5)) };
        let mut row = Row { coefficient: t * draw.between(-1.0, 1.0), bound: 0.3 * gap };
        if !first && draw.chance(0.1) {
            row = last; // coincident breakpoints
        }
        if draw.chance(0.05) {
            row.coefficient = 0.0;
        }
        (last, first) = (row, false);
        assert!(p.push_comfort(row));
        if draw.chance(0.7) {
            assert!(p.push_safety(Row { bound: row.bound / 0.6, ..row }));
        }
    }
    p
}

/// `programme` with its v-part or its ω-part in other units: the minimiser does not move.
fn rescaled(p: &Programme, factor: f64) -> Programme {
    let mut q = p.clone();
    let scale = |c: Certificate| Certificate {
        linear: c.linear * factor,
        curvature: c.curvature * factor,
        decrease: c.decrease * factor,
    };
    (q.position, q.heading) = (scale(p.position), scale(p.heading));
    q.weights.position /= factor;
    q.weights.heading /= factor;
    q.weights.comfort /= factor;
    for row in q.comfort.iter_mut().chain(&mut q.safety) {
        *row = Row { coefficient: row.coefficient * factor, bound: row.bound * factor };
    }
    q
}

/// Largest disagreement over a set of programmes.
#[derive(Default, Debug)]
struct Worst {
    objective_rel: f64,
    input: f64,
    kkt: f64,
    not_solved: usize,
}

impl Worst {
    fn add(&mut self, p: &Programme, reference: &Solution, other: &Solution) {
        let value = |s: &Solution| p.objective(s.v_mps, s.omega_radps);
        let (a, b) = (value(reference), value(other));
        self.objective_rel = self.objective_rel.max((a - b).abs() / (1.0 + a.abs()));
        let gap =
            (reference.v_mps - other.v_mps).abs().max((reference.omega_radps - other.omega_radps).abs());
        self.input = self.input.max(gap);
        self.kkt = self.kkt.max(Residuals::of(p, other).max());
    }
}

/// The programmes that robots meet on their way through a scenario.
fn closed_loop_programmes(name: &str) -> Vec<Programme> {
    let config = Config::new(Scenario::builtin(name).unwrap());
    let mut fleet = evaluation::initial_fleet(&config);
    let mut group = RobotGroup::new(&config, 0..fleet.len()).unwrap();
    let mut programmes = Vec::new();
    for _ in 0..120 {
        let mut next = fleet.clone();
        group.solve_watched(&fleet, Timing::LogicalExecutionTime, |index, decision, programme| {
            next[index].set_command(decision.command.command());
            next[index].intent = decision.intent;
            programmes.push(programme.clone());
        });
        for (robot, new) in fleet.iter_mut().zip(&next) {
            robot.set_pose(robot.arc().pose(config.timing.period_s()));
            robot.set_command(new.command());
            robot.intent = new.intent;
        }
    }
    programmes
}

#[test]
fn clarabel_agrees_with_the_exact_solver_on_the_programmes_of_closed_loops() {
    for name in ["swap8", "swap8-zero", "circle-20", "random-20-3"] {
        let programmes = closed_loop_programmes(name);
        let mut next = programmes.iter();
        let (raw, polished) = compare(programmes.len(), 0, |_| next.next().unwrap().clone());
        println!("{name} {} raw {raw:?}\n   polished {polished:?}", programmes.len());
        assert_eq!(raw.not_solved, 0, "{name}");
        assert!(raw.objective_rel < 1e-6, "{name} {raw:?}");
        assert!(polished.objective_rel < 1e-6 && polished.input < 1e-6, "{name} {polished:?}");
    }
}

/// Compares Clarabel, as it is and with its last digits polished, with the exact solver.
fn compare(count: usize, seed: u64, mut next: impl FnMut(&mut Draw) -> Programme) -> (Worst, Worst) {
    let mut draw = Draw(seed);
    let mut raw = ClarabelSolver::new(LARGE).unwrap().without_polish();
    let mut polished = ClarabelSolver::new(LARGE).unwrap();
    let [mut a, mut b, mut c] = [(); 3].map(|()| Solution::with_capacity(LARGE));
    let (mut worst_raw, mut worst_polished) = (Worst::default(), Worst::default());
    for _ in 0..count {
        let p = next(&mut draw);
        assert_eq!(ExactSolver.solve(&p, &mut a), Outcome::Solved);
        if raw.solve(&p, &mut b) == Outcome::Solved {
            worst_raw.add(&p, &a, &b);
            assert_eq!(polished.solve(&p, &mut c), Outcome::Solved);
            worst_polished.add(&p, &a, &c);
        } else {
            worst_raw.not_solved += 1;
        }
    }
    (worst_raw, worst_polished)
}

#[test]
fn clarabel_agrees_with_the_exact_solver_on_random_and_degenerate_data() {
    let (raw, polished) = compare(20_000, 1, random_programme);
    println!("raw {raw:?}\npolished {polished:?}");
    assert_eq!(raw.not_solved, 0);
    assert!(raw.objective_rel < 1e-6 && raw.input < 1e-3, "{raw:?}");
    assert!(polished.objective_rel < 1e-6 && polished.input < 1e-6 && polished.kkt < 1e-9, "{polished:?}");
}

#[test]
fn solvers_agree_when_the_data_are_scaled() {
    for factor in [1e-6, 1e-3, 1e3, 1e6] {
        let (raw, polished) = compare(2_000, 7, |draw| rescaled(&random_programme(draw), factor));
        println!("{factor:e} raw {raw:?} polished {polished:?}");
        assert_eq!(raw.not_solved, 0, "{factor:e}");
        assert!(polished.objective_rel < 1e-6 && polished.input < 1e-6, "{factor:e} {polished:?}");
    }
}

/// `programme` with each of its parts in units of its own, up to 1e±12: the minimiser does not move.
fn rescaled_apart(p: &Programme, draw: &mut Draw) -> Programme {
    let mut factor = || {
        let exponent = draw.between(-12.0, 12.0);
        10f64.powf(if draw.chance(0.3) { 12f64.copysign(exponent) } else { exponent })
    };
    let scale = |c: Certificate, factor: f64| Certificate {
        linear: c.linear * factor,
        curvature: c.curvature * factor,
        decrease: c.decrease * factor,
    };
    let mut q = p.clone();
    let [position, heading, comfort] = [(); 3].map(|()| factor());
    (q.position, q.heading) = (scale(p.position, position), scale(p.heading, heading));
    q.weights.position /= position;
    q.weights.heading /= heading;
    q.weights.comfort /= comfort;
    let row =
        |row: Row, factor: f64| Row { coefficient: row.coefficient * factor, bound: row.bound * factor };
    q.comfort.iter_mut().for_each(|one| *one = row(*one, comfort));
    q.safety.iter_mut().for_each(|one| *one = row(*one, factor()));
    q
}

/// Data that are scaled by up to 1e±12 are solved as well as those that are not, or declined; never answered
/// wrongly.
#[test]
fn data_scaled_by_twelve_orders_agree_with_the_reference_or_are_declined() {
    let mut draw = Draw(8);
    let mut clarabel = ClarabelSolver::new(CAPACITY).unwrap();
    let [mut plain, mut exact, mut reference] = [(); 3].map(|()| Solution::with_capacity(CAPACITY));
    let (mut solved, mut agreed, count) = (0, 0, 4_000);
    for n in 0..count {
        let p = random_programme(&mut draw);
        let q = match n % 4 {
            0 => rescaled(&p, 1e-12),
            1 => rescaled(&p, 1e12),
            _ => rescaled_apart(&p, &mut draw),
        };
        assert_eq!(ExactSolver.solve(&p, &mut plain), Outcome::Solved);
        let value = p.objective(plain.v_mps, plain.omega_radps);
        let same = |name: &str, s: &Solution| {
            // Judged by the data as they were.
            let (v_mps, other) = (s.v_mps, p.objective(s.v_mps, s.omega_radps));
            let admissible = p.safety.iter().all(|row| row.coefficient * v_mps <= row.bound + 1e-9);
            let agrees = (other - value).abs() <= 1e-6 * (1.0 + value.abs());
            assert!(admissible && agrees, "{name}: {other} for {value}\n{s:?}\n{plain:?}\n{q:?}");
        };
        if ExactSolver.solve(&q, &mut exact) == Outcome::Solved {
            same("exact", &exact);
            solved += 1;
        }
        if clarabel.solve(&q, &mut reference) == Outcome::Solved {
            same("clarabel", &reference);
            agreed += 1;
        }
    }
    println!("of {count}: {solved} solved exactly, {agreed} by Clarabel");
    assert!(solved >= count * 9 / 10 && agreed >= count / 2, "{solved} {agreed}");
}

/// A robot in a crowd may have next to no speed left, by a row or by the guidance's cap.
#[test]
fn solvers_agree_on_robots_that_can_hardly_move() {
    let with = |speed: f64, capped: bool| {
        let mut p = Programme::with_capacity(Weights::default(), CAPACITY);
        p.position = Certificate { linear: -0.4, curvature: 0.0064, decrease: 1.92 };
        p.heading = Certificate { linear: -1.3e-9, curvature: 0.0064, decrease: 1e-16 };
        p.v_mps = Interval { min: 0.0, max: if capped { speed } else { 2.0 } };
        p.omega_radps = Interval { min: -1.0, max: 1.0 };
        let row = |gap: f64| Row { coefficient: 0.078, bound: gap };
        for bound in [if capped { 0.01 } else { 0.078 * speed }, 0.2] {
            assert!(p.push_safety(row(bound)) && p.push_comfort(row(0.9 * bound)));
        }
        p
    };
    let programmes: Vec<Programme> = (0..72)
        .flat_map(|k| [true, false].map(|capped| with(10f64.powf(-0.25 * f64::from(k)), capped)))
        .collect();
    let mut next = programmes.iter();
    let (raw, polished) = compare(programmes.len(), 0, |_| next.next().unwrap().clone());
    assert_eq!(raw.not_solved, 0, "{raw:?}");
    assert!(raw.objective_rel < 1e-6 && polished.objective_rel < 1e-6, "{raw:?} {polished:?}");
    assert!(polished.input < 1e-6, "{polished:?}");
}

/// Minutes long: `cargo test --release --test solvers -- --ignored`.
#[test]
#[ignore = "a million interior point solves take minutes"]
fn solvers_agree_on_a_million_programmes() {
    let (raw, polished) = compare(1_000_000, 11, random_programme);
    println!("raw {raw:?}\npolished {polished:?}");
    assert_eq!(raw.not_solved, 0);
    assert!(polished.objective_rel < 1e-6 && polished.input < 1e-6 && polished.kkt < 1e-9, "{polished:?}");
}

#[test]
fn exact_solver_meets_the_optimality_conditions() {
    let mut draw = Draw(2);
    let mut s = Solution::with_capacity(CAPACITY);
    for _ in 0..300_000 {
        let p = random_programme(&mut draw);
        assert_eq!(ExactSolver.solve(&p, &mut s), Outcome::Solved);
        let kkt = Residuals::of(&p, &s);
        assert!(kkt.max() < 1e-9, "{kkt:?} {p:?} {s:?}");
    }
}

/// Convexity makes a local check a global one: no admissible step away from the solution helps.
#[test]
fn no_neighbouring_input_is_better() {
    let mut draw = Draw(3);
    let mut s = Solution::with_capacity(CAPACITY);
    for _ in 0..20_000 {
        let p = random_programme(&mut draw);
        assert_eq!(ExactSolver.solve(&p, &mut s), Outcome::Solved);
        let best = p.objective(s.v_mps, s.omega_radps);
        let (v, omega) = (p.admissible_v(), p.omega_radps);
        for step in [1e-1, 1e-3, 1e-5] {
            for (dv, dw) in [(step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step)] {
                let other = p.objective(
                    (s.v_mps + dv).clamp(v.min, v.max),
                    (s.omega_radps + dw).clamp(omega.min, omega.max),
                );
                assert!(other >= best - 1e-9 * (1.0 + best.abs()), "{other} < {best}: {p:?}");
            }
        }
    }
}

#[test]
fn every_solver_returns_the_same_bits_again() {
    let mut draw = Draw(4);
    let mut clarabel = ClarabelSolver::new(CAPACITY).unwrap();
    let programmes: Vec<Programme> = (0..500).map(|_| random_programme(&mut draw)).collect();
    let run = |solver: &mut dyn Solver| -> Vec<Solution> {
        let mut s = Solution::with_capacity(CAPACITY);
        programmes
            .iter()
            .map(|p| {
                assert_eq!(solver.solve(p, &mut s), Outcome::Solved);
                s.clone()
            })
            .collect()
    };
    assert_eq!(run(&mut ExactSolver), run(&mut ExactSolver));
    assert_eq!(run(&mut clarabel), run(&mut clarabel));
}

#[test]
fn ill_posed_data_are_declined_by_every_solver() {
    let good = random_programme(&mut Draw(5));
    let mut bad = Vec::new();
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut with = |change: &dyn Fn(&mut Programme)| {
            let mut p = good.clone();
            change(&mut p);
            bad.push(p);
        };
        with(&|p| p.position.linear = value);
        with(&|p| p.heading.decrease = value);
        with(&|p| p.v_mps.max = value);
        with(&|p| p.weights.v = value);
        with(&|p| {
            p.clear_rows();
            assert!(p.push_safety(Row { coefficient: value, bound: 1.0 }));
        });
    }
    let mut negative = good.clone();
    negative.v_mps.min = 0.5; // a stop would not be admissible
    bad.push(negative);
    let mut s = Solution::with_capacity(CAPACITY);
    let mut clarabel = ClarabelSolver::new(CAPACITY).unwrap();
    for p in bad {
        assert_eq!(ExactSolver.solve(&p, &mut s), Outcome::IllPosed, "{p:?}");
        assert_eq!(clarabel.solve(&p, &mut s), Outcome::IllPosed, "{p:?}");
    }
}

#[test]
fn a_programme_larger_than_the_workspace_is_declined() {
    let mut p = Programme::with_capacity(Weights::default(), CAPACITY);
    for _ in 0..CAPACITY {
        assert!(p.push_comfort(Row { coefficient: 0.08, bound: 1.0 }));
    }
    assert!(!p.push_comfort(Row::default()), "the list never grows");
    let mut s = Solution::with_capacity(CAPACITY);
    assert_eq!(ClarabelSolver::new(8).unwrap().solve(&p, &mut s), Outcome::TooLarge);
    assert_eq!(ClarabelSolver::new(CAPACITY).unwrap().solve(&p, &mut s), Outcome::Solved);
}

/// Verification refuses what is not a solution, whatever it was told.
#[test]
fn verification_sees_every_kind_of_damage() {
    let mut draw = Draw(6);
    let mut s = Solution::with_capacity(CAPACITY);
    let mut seen = 0;
    for _ in 0..2_000 {
        let p = random_programme(&mut draw);
        assert_eq!(ExactSolver.solve(&p, &mut s), Outcome::Solved);
        let damage: [&dyn Fn(&mut Solution); 6] = [
            &|s| s.v_mps += 0.1,
            &|s| s.omega_radps = f64::NAN,
            &|s| s.dual_position = -1.0,
            &|s| s.dual_heading += 20_000.0,
            &|s| s.slack_position = -0.1,
            &|s| s.dual_v[1] += 5.0,
        ];
        for change in damage {
            let mut broken = s.clone();
            change(&mut broken);
            assert!(Residuals::of(&p, &broken).max() > 1e-6, "{p:?} {broken:?}");
            seen += 1;
        }
    }
    assert_eq!(seen, 12_000);
}
