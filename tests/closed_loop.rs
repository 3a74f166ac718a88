//! The controller around the exact plant.

use clearway::config::{Config, SolverKind};
use clearway::controller::Timing;
use clearway::evaluation::{self, Evaluation};
use clearway::scenario::Scenario;

fn evaluate(name: &str, timing: Timing, change: impl FnOnce(&mut Config)) -> Evaluation {
    let mut config = Config::new(Scenario::builtin(name).unwrap());
    change(&mut config);
    evaluation::run(&config, timing, |_, _| {}).unwrap()
}

#[test]
fn the_swap_arrives_without_a_violation() {
    for name in ["swap8", "swap8-zero"] {
        for timing in [Timing::Ideal, Timing::LogicalExecutionTime] {
            let e = evaluate(name, timing, |_| {});
            println!("{}", serde_json::to_string(&e).unwrap());
            assert!(e.passed(), "{e:?}");
            assert_eq!(e.fallback_commands, 0);
        }
    }
}

#[test]
fn clarabel_drives_the_swap_as_well() {
    let e = evaluate("swap8", Timing::LogicalExecutionTime, |c| c.controller.solver = SolverKind::Clarabel);
    println!("{}", serde_json::to_string(&e).unwrap());
    assert!(e.passed(), "{e:?}");
    assert_eq!(e.fallback_commands, 0);
}
