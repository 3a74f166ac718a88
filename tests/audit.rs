//! The shadow audit notices what it is there for, and never holds up the side that must not wait.

use clearway::audit::{self, TOLERANCE};
use clearway::config::Weights;
use clearway::programme::{Certificate, Interval, Programme, Row, Solution};
use clearway::solver::{ClarabelSolver, ExactSolver, Outcome, Solver};

const ROWS: usize = 8;

/// A robot `distance_m` from its goal with a row that leaves it `speed_mps`.
fn programme(distance_m: f64, speed_mps: f64) -> Programme {
    let (t, mut p) = (0.08, Programme::with_capacity(Weights::default(), ROWS));
    let decrease = 0.5 * distance_m * distance_m;
    p.position = Certificate { linear: -t * distance_m, curvature: t * t, decrease };
    p.heading = Certificate { linear: 0.03, curvature: t * t, decrease: 0.01 };
    p.v_mps = Interval { min: 0.0, max: 5.0 };
    p.omega_radps = Interval { min: -1.0, max: 1.0 };
    assert!(p.push_safety(Row { coefficient: t, bound: t * speed_mps }));
    assert!(p.push_comfort(Row { coefficient: t, bound: 0.8 * t * speed_mps }));
    p
}

fn solved(programme: &Programme) -> Solution {
    let mut solution = Solution::with_capacity(ROWS);
    assert_eq!(ExactSolver.solve(programme, &mut solution), Outcome::Solved);
    solution
}

#[test]
fn right_solutions_agree() {
    let (mut recorder, mut auditor) = audit::start(ClarabelSolver::new(ROWS).unwrap(), ROWS, 64, 1);
    for k in 0..50 {
        let p = programme(0.2 * f64::from(k), 0.1 * f64::from(k));
        assert!(recorder.offer(&p, &solved(&p)));
    }
    assert_eq!(auditor.audit(20), 20);
    assert_eq!(auditor.audit(usize::MAX), 30);
    let report = auditor.report();
    assert_eq!((report.audited, report.disagreed, report.not_solved, report.dropped), (50, 0, 0, 0));
    assert!(report.max_input_gap <= TOLERANCE && report.max_objective_gap_rel <= TOLERANCE, "{report:?}");
    assert_eq!(auditor.worst(), None);
}

#[test]
fn a_wrong_solution_is_noticed() {
    type Damage = fn(&mut Solution);
    let damages: [Damage; 4] =
        [|s| s.v_mps += 1e-3, |s| s.v_mps = 0.0, |s| s.omega_radps -= 1e-5, |s| s.omega_radps = f64::NAN];
    for damage in damages {
        let (mut recorder, mut auditor) = audit::start(ClarabelSolver::new(ROWS).unwrap(), ROWS, 4, 1);
        let (good, bad) = (programme(3.0, 2.0), programme(4.0, 1.0));
        let mut wrong = solved(&bad);
        damage(&mut wrong);
        recorder.offer(&good, &solved(&good));
        recorder.offer(&bad, &wrong);
        auditor.audit(usize::MAX);
        let report = auditor.report();
        assert_eq!((report.audited, report.disagreed), (2, 1), "{report:?}");
        assert!(report.max_input_gap > TOLERANCE, "{report:?}");
        assert_eq!(auditor.worst(), Some(&bad));
    }
}

#[test]
fn what_finds_no_slot_is_dropped_and_counted() {
    let (mut recorder, mut auditor) = audit::start(ExactSolver, ROWS, 4, 1);
    let p = programme(3.0, 2.0);
    let s = solved(&p);
    assert_eq!((0..10).filter(|_| recorder.offer(&p, &s)).count(), 4);
    assert_eq!(auditor.audit(usize::MAX), 4);
    assert_eq!(auditor.report().dropped, 6);
    assert!(recorder.offer(&p, &s), "the slots are back");

    let (mut small, mut auditor) = audit::start(ExactSolver, 0, 4, 1);
    assert!((0..10).all(|_| !small.offer(&p, &s)), "more rows than a slot holds");
    auditor.audit(usize::MAX);
    assert_eq!((auditor.report().audited, auditor.report().dropped), (0, 10));
}

#[test]
fn one_in_so_many_is_recorded() {
    let (mut recorder, mut auditor) = audit::start(ExactSolver, ROWS, 64, 5);
    let p = programme(3.0, 2.0);
    let s = solved(&p);
    assert_eq!((0..50).filter(|_| recorder.offer(&p, &s)).count(), 10);
    auditor.audit(usize::MAX);
    assert_eq!((auditor.report().audited, auditor.report().dropped), (10, 0));
}

#[test]
fn every_offer_is_audited_or_dropped_across_threads() {
    const OFFERS: u64 = 20_000;
    let (recorder, mut auditor) = audit::start(ExactSolver, ROWS, 16, 1);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..2)
            .map(|k| {
                let mut recorder = recorder.clone();
                scope.spawn(move || {
                    let p = programme(3.0, f64::from(k));
                    let s = solved(&p);
                    (0..OFFERS).filter(|_| recorder.offer(&p, &s)).count()
                })
            })
            .collect();
        while !workers.iter().all(std::thread::ScopedJoinHandle::is_finished) {
            auditor.audit(usize::MAX);
        }
        auditor.audit(usize::MAX);
        let recorded: usize = workers.into_iter().map(|w| w.join().unwrap()).sum();
        let report = auditor.report();
        assert_eq!(report.audited, recorded as u64);
        assert_eq!(report.audited + report.dropped, 2 * OFFERS);
        assert_eq!(report.disagreed, 0, "a sample is never seen half written");
    });
}
