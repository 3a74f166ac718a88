//! What came out, as JSON and as a table.

use super::drive::Drive;
use super::memory::step_bytes;
use crate::plot::{Axis, Figure, Panel, Style};
use clearway::report::Report;
use clearway::wire::{RobotTelemetry, TelemetryHeader};
use serde::Serialize;
use std::fmt::Write;

/// Quantiles of times, ms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(super) struct Milliseconds {
    pub(super) p50: f64,
    pub(super) p99: f64,
    pub(super) max: f64,
}

impl Milliseconds {
    /// By nearest rank, of times in ns.
    fn of(times_ns: &[u64]) -> Self {
        let mut sorted = times_ns.to_vec();
        sorted.sort_unstable();
        let at = |percent: usize| {
            let rank = (sorted.len() * percent).div_ceil(100);
            sorted.get(rank.saturating_sub(1)).map_or(0.0, |ns| *ns as f64 * 1e-6)
        };
        Self { p50: at(50), p99: at(99), max: at(100) }
    }
}

/// The periods that were watched, ns each.
#[derive(Debug, Clone, Default)]
pub(super) struct Samples {
    step: Vec<u64>,
    /// Steps of the warm-up.
    early: Vec<u64>,
    /// Periods that did not fit even into the slowed clock's.
    cut_off: u64,
    publish_states: Vec<u64>,
    work: Vec<u64>,
    collect: Vec<u64>,
    robots: u64,
    robot_step_ns: u64,
    solve_ns: u64,
    speed_mps: f64,
}

impl Samples {
    /// A period before the traffic is steady.
    pub(super) fn add_early(&mut self, header: &TelemetryHeader, slowdown: u64) {
        self.early.push(header.state_to_command_ns.saturating_sub(header.state_publish_ns) * slowdown);
    }

    /// A period that is timed; the header's times are those of a clock slower by `slowdown`.
    pub(super) fn add(&mut self, header: &TelemetryHeader, robots: &[RobotTelemetry], slowdown: u64) {
        let header = TelemetryHeader {
            state_publish_ns: header.state_publish_ns * slowdown,
            state_to_command_ns: header.state_to_command_ns * slowdown,
            state_to_staged_ns: header.state_to_staged_ns * slowdown,
            ..*header
        };
        let published = header.state_publish_ns;
        self.step.push(header.state_to_command_ns.saturating_sub(published));
        self.publish_states.push(published);
        self.cut_off += header.skipped_periods + u64::from(header.deadline_lateness_ns > 0);
        // 0 where a worker was late: the period is a miss and its parts mean nothing.
        if header.state_to_staged_ns > 0 {
            self.work.push(header.state_to_staged_ns.saturating_sub(published));
            self.collect.push(header.state_to_command_ns.saturating_sub(header.state_to_staged_ns));
        }
        self.robots += robots.len() as u64;
        self.robot_step_ns += robots.iter().map(|r| r.step_ns).sum::<u64>();
        self.solve_ns += robots.iter().map(|r| r.solve_ns).sum::<u64>();
        self.speed_mps += robots.iter().map(|r| r.v_mps.abs()).sum::<f64>();
    }
}

/// One fleet's figures.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Case {
    pub(super) robots: usize,
    pub(super) workers: usize,
    /// Others within the distance at which a safety row can bind, on average.
    pub(super) neighbours_mean: f64,
    /// From the states in shared memory to the commands published.
    pub(super) step_ms: Milliseconds,
    /// Median step times workers, over robots: processor time, not elapsed.
    pub(super) ns_per_robot: f64,
    pub(super) budget_ms: f64,
    /// Timed steps that took longer than the budget.
    pub(super) deadline_misses: u64,
    /// How much slower time passed for the daemon, so that no step was cut off.
    pub(super) slowdown: u64,
    /// Timed periods that were cut off or skipped even so: their times are lower bounds.
    pub(super) cut_off: u64,
    /// Records that telemetry lost, warm-up included.
    pub(super) records_lost: u64,
    /// The slowest step of the warm-up, ms.
    pub(super) warm_up_max_ms: f64,
    /// What the step moves for each robot, by count, and how long memory takes to copy that for all.
    pub(super) bytes_per_robot: usize,
    pub(super) copy_gb_per_s: f64,
    pub(super) memory_bound_ms: f64,
    /// Median step over that bound.
    pub(super) times_memory_bound: f64,
    /// Periods whose times are above, and those that were driven.
    pub(super) periods: usize,
    pub(super) periods_driven: u64,
    pub(super) stages_ms: Stages,
    /// A robot's step without the sorting of the fleet, and of it the solver, mean ns.
    pub(super) robot_step_ns: f64,
    pub(super) solve_ns: f64,
    /// Mean speed of the robots, m/s.
    pub(super) speed_mps: f64,
    /// Stops in place of verified commands.
    pub(super) fallback_commands: u64,
    pub(super) violations: usize,
}

/// The parts of a period.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Stages {
    /// Poses taken and states published; before the step.
    pub(super) publish_states: Milliseconds,
    /// Workers: from the states to the last command staged.
    pub(super) work: Milliseconds,
    /// Commands collected and published.
    pub(super) collect: Milliseconds,
}

impl Case {
    pub(super) fn new(
        drive: Drive,
        neighbours_mean: f64,
        period_ns: u64,
        s: &Samples,
        report: &Report,
    ) -> Self {
        let step_ms = Milliseconds::of(&s.step);
        let robots = s.robots.max(1) as f64;
        let bytes_per_robot = step_bytes(drive.workers);
        let memory_bound_ms = (bytes_per_robot * drive.robots) as f64 / drive.copy_bytes_per_s.max(1.0) * 1e3;
        Self {
            robots: drive.robots,
            workers: drive.workers,
            neighbours_mean,
            step_ms,
            ns_per_robot: step_ms.p50 * 1e6 * drive.workers as f64 / drive.robots as f64,
            budget_ms: period_ns as f64 * 1e-6,
            deadline_misses: s.step.iter().filter(|step| **step > period_ns).count() as u64,
            slowdown: drive.slowdown.get(),
            cut_off: s.cut_off,
            records_lost: report.lost_records,
            warm_up_max_ms: Milliseconds::of(&s.early).max,
            bytes_per_robot,
            copy_gb_per_s: drive.copy_bytes_per_s * 1e-9,
            memory_bound_ms,
            times_memory_bound: step_ms.p50 / memory_bound_ms,
            periods: s.step.len(),
            periods_driven: report.ticks,
            stages_ms: Stages {
                publish_states: Milliseconds::of(&s.publish_states),
                work: Milliseconds::of(&s.work),
                collect: Milliseconds::of(&s.collect),
            },
            robot_step_ns: s.robot_step_ns as f64 / robots,
            solve_ns: s.solve_ns as f64 / robots,
            speed_mps: s.speed_mps / robots,
            fallback_commands: report.fallback_commands,
            violations: report.control.violations,
        }
    }
}

/// Fleets of several sizes.
#[derive(Debug, Serialize)]
pub(super) struct Curve {
    pub(super) cases: Vec<Case>,
}

impl Curve {
    /// One line a fleet, at most 80 columns wide.
    pub(super) fn table(&self) -> String {
        let mut text =
            String::from("  robots  near  step ms p50    p99    max  ns/robot  misses  periods  slow  cut\n");
        for c in &self.cases {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{:8} {:5.2} {:12.1} {:6.1} {:6.1} {:9.0} {:7} {:8} {:5} {:4}",
                c.robots,
                c.neighbours_mean,
                c.step_ms.p50,
                c.step_ms.p99,
                c.step_ms.max,
                c.ns_per_robot,
                c.deadline_misses,
                c.periods,
                c.slowdown,
                c.cut_off
            );
        }
        text += "near: others that can bind. ns/robot: processor time, median step x workers.\n";
        text += "misses: steps over 80 ms. slow: how much slower the daemon's time passed.\n";
        if let Some(c) = self.cases.last() {
            let _ = writeln!(
                text,
                "memory: {} bytes a robot and step, copied at {:.1} GB/s: {:.1} ms for {} robots;\n\
                 the median step takes {:.0} times as long.",
                c.bytes_per_robot, c.copy_gb_per_s, c.memory_bound_ms, c.robots, c.times_memory_bound
            );
        }
        text
    }

    /// Step times and cost a robot over the size of the fleet.
    pub(super) fn svg(&self) -> String {
        let points = |of: fn(&Case) -> f64| self.cases.iter().map(|c| (c.robots as f64, of(c))).collect();
        let mut times = Panel::new(Axis::log("robots", ""), Axis::log("step", "ms"));
        times.line("median", points(|c| c.step_ms.p50), Style::nth(0));
        times.line("99th percentile", points(|c| c.step_ms.p99), Style::nth(1));
        if let Some(case) = self.cases.first() {
            times.level(case.budget_ms, "budget");
        }
        times.line("copying its bytes", points(|c| c.memory_bound_ms), Style::nth(2));
        let mut cost = Panel::new(Axis::log("robots", ""), Axis::linear("cost a robot", "ns").from(0.0));
        cost.line("median", points(|c| c.ns_per_robot), Style::nth(0));
        Figure::new("A period over the size of the fleet").with(times).with(cost).svg()
    }
}
