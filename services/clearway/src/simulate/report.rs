//! What a run over seeds found: its table, its JSON.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

use clearway::simulation::{Class, Failure, Kind, Outcome};
use serde::Serialize;

/// Failing seeds whose faults are made fewer; the others are told as they are.
pub(super) const SHRUNK_MAX: usize = 10;
/// Failing seeds of which the table tells.
const TOLD_MAX: usize = 20;

/// One kind of fault over all seeds.
#[derive(Debug, Default, Serialize)]
struct Row {
    /// Faults that were drawn and had their time.
    faults: u64,
    /// How often something was done about them: samples forged, turns not taken.
    times: u64,
    /// Faults after which the counter that tells of them had moved.
    counted: u64,
    /// Periods after a fault until the last robot that it concerned was driven again.
    recovery_p50: u64,
    recovery_max: u64,
    #[serde(skip)]
    recoveries: Vec<u64>,
}

/// A seed in which something did not hold.
#[derive(Debug, Serialize)]
pub(super) struct Failed {
    seed: u64,
    class: &'static str,
    failures: Vec<Failure>,
    /// The faults that are needed for it.
    faults: Vec<String>,
    replay: String,
}

impl Failed {
    pub(super) fn new(outcome: &Outcome, left: &[usize], replay: String) -> Self {
        let faults = outcome.faults.iter().filter(|fault| left.contains(&fault.number));
        Self {
            seed: outcome.seed,
            class: outcome.class.name(),
            failures: outcome.failures.clone(),
            faults: faults.map(ToString::to_string).collect(),
            replay,
        }
    }
}

/// One seed, as a line.
#[derive(Serialize)]
pub(super) struct Line<'a> {
    seed: u64,
    class: &'static str,
    robots: usize,
    workers: usize,
    periods: u64,
    digest: String,
    faults: Vec<String>,
    failures: &'a [Failure],
}

impl<'a> Line<'a> {
    pub(super) fn of(outcome: &'a Outcome) -> Self {
        Self {
            seed: outcome.seed,
            class: outcome.class.name(),
            robots: outcome.robots,
            workers: outcome.workers,
            periods: outcome.periods,
            digest: format!("{:016x}", outcome.digest),
            faults: outcome.faults.iter().map(ToString::to_string).collect(),
            failures: &outcome.failures,
        }
    }
}

/// All seeds together.
#[derive(Debug, Default, Serialize)]
pub(super) struct Simulation {
    seeds: u64,
    periods: u64,
    robot_periods: u64,
    wall_s: f64,
    periods_per_s: f64,
    kinds: BTreeMap<&'static str, Row>,
    pub(super) failed: Vec<Failed>,
}

impl Simulation {
    pub(super) fn add(&mut self, outcome: &Outcome) {
        self.seeds += 1;
        self.periods += outcome.periods;
        self.robot_periods += outcome.periods * outcome.robots as u64;
        for shown in &outcome.shown {
            let row = self.kinds.entry(shown.kind.name()).or_default();
            row.faults += 1;
            row.times += shown.applied;
            row.counted += u64::from(shown.moved);
            if shown.applied > 0 {
                row.recoveries.push(shown.recovery);
            }
        }
    }

    pub(super) fn finish(&mut self, wall: Duration) {
        self.wall_s = wall.as_secs_f64();
        self.periods_per_s = self.periods as f64 / self.wall_s.max(1e-9);
        self.failed.sort_by_key(|failed| failed.seed);
        for row in self.kinds.values_mut() {
            row.recoveries.sort_unstable();
            row.recovery_p50 = row.recoveries.get(row.recoveries.len() / 2).copied().unwrap_or(0);
            row.recovery_max = row.recoveries.last().copied().unwrap_or(0);
        }
    }

    pub(super) fn table(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = writeln!(
            out,
            "{:18} {:>7} {:>7} {:>7} {:>16}  counter",
            "fault", "faults", "times", "counted", "recovery p50/max"
        );
        for (name, row) in &self.kinds {
            let counter = Kind::from_name(name).and_then(|kind| kind.promise().counter());
            let _ = writeln!(
                out,
                "{name:18} {:>7} {:>7} {:>7} {:>16}  {}",
                row.faults,
                row.times,
                row.counted,
                format!("{}/{}", row.recovery_p50, row.recovery_max),
                counter.unwrap_or_else(|| "–".to_owned())
            );
        }
        let _ = writeln!(
            out,
            "\n{} seeds, {} periods, {:.1} s: {:.0} periods/s, {:.0} robots' commands/s",
            self.seeds,
            self.periods,
            self.wall_s,
            self.periods_per_s,
            self.robot_periods as f64 / self.wall_s.max(1e-9)
        );
        for failed in self.failed.iter().take(TOLD_MAX) {
            let _ = writeln!(out, "\nseed {} ({}) does not hold:", failed.seed, failed.class);
            for failure in &failed.failures {
                let robot = failure.robot.map_or(String::new(), |robot| format!(", robot {robot}"));
                let (letter, period) = (failure.invariant, failure.period);
                let _ = writeln!(out, "  ({letter}) period {period}{robot}: {}", failure.values);
            }
            for fault in &failed.faults {
                let _ = writeln!(out, "    {fault}");
            }
            let _ = writeln!(out, "  {}", failed.replay);
        }
        if self.failed.is_empty() {
            let _ = writeln!(out, "Everything held in all of them.");
        } else {
            let _ = writeln!(out, "\n{} of {} seeds do not hold.", self.failed.len(), self.seeds);
        }
        out
    }
}

/// The kinds of faults and the classes of fleets.
pub(super) fn list() -> String {
    let mut out = String::new();
    for kind in Kind::ALL.iter().filter(|kind| kind.promise().is_fault()) {
        let promise = kind.promise();
        let counter = promise.counter().unwrap_or_else(|| "–".to_owned());
        let _ = writeln!(out, "{:18} {}\n{:18} counter {counter}", promise.name, promise.policy, "");
    }
    let classes: Vec<&str> = Class::ALL.iter().map(|class| class.name()).collect();
    let _ = writeln!(out, "\nclasses of fleets: {}", classes.join(", "));
    out
}
