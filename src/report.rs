//! What a run of the daemon is judged by: its report.
//!
//! Reads the figures of the control task and of the loop, writes one JSON object. Times in
//! nanoseconds, distances in metres. Made once, when a run is over.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::admission::Rejections;
use crate::audit::AuditReport;
use crate::figures::{ControlFigures, LatencyNs};
use crate::realtime::Achieved;

/// The daemon's report.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Name of the scenario.
    pub scenario: String,
    /// The control law.
    pub profile: &'static str,
    /// The solver.
    pub solver: &'static str,
    /// How well the task was done.
    #[serde(flatten)]
    pub control: ControlFigures,
    /// Why the run ended.
    pub ended_by: &'static str,
    /// Worker threads.
    pub workers: usize,
    /// Sampling period T, ns.
    pub period_ns: u64,
    /// Periods that were released.
    pub ticks: u64,
    /// Of these, the periods whose commands went out; those of the others came too late and did not.
    pub published_periods: u64,
    /// Periods that passed as a whole because the loop overran.
    pub skipped_periods: u64,
    /// Periods, skipped ones included, for which a command was missing or late.
    pub deadline_misses: u64,
    /// Stops in place of verified commands, but for the start and the end of the run: those of
    /// skipped and late periods included.
    pub fallback_commands: u64,
    /// Stops by reason.
    pub stops: BTreeMap<&'static str, u64>,
    /// From the scheduled start of a period to the loop being awake, ns.
    pub release_lateness_ns: LatencyNs,
    /// From waking to the state being published and the workers woken, ns.
    pub state_publish_ns: LatencyNs,
    /// From the stamp of the state to a worker reading it, ns.
    pub state_to_worker_ns: LatencyNs,
    /// From the stamp of the state to the last command being staged, ns.
    pub state_to_staged_ns: LatencyNs,
    /// From the stamp of the state to the commands being published, ns. At the latest the
    /// deadline: the period less its margin; always that when commands are published at the deadline.
    /// Of the periods whose commands went out.
    pub state_to_command_ns: LatencyNs,
    /// From the deadline to the commands being published, ns.
    pub deadline_lateness_ns: LatencyNs,
    /// The solver alone, for one robot, ns.
    pub solve_ns: LatencyNs,
    /// A robot's whole step, ns.
    pub step_ns: LatencyNs,
    /// What the kernel granted.
    pub realtime: Achieved,
    /// Observations refused, by reason.
    pub rejected_inputs: Rejections,
    /// What the shadow audit found; null when there was none.
    pub audit: Option<AuditReport>,
    /// Times that a worker panicked and was built anew.
    pub worker_panics: u64,
    /// Times that the thread which answers operators panicked; each lost a request.
    pub admin_panics: u64,
    /// States that had changed in memory when a worker read them; it answered none of these.
    pub corrupt_states: u64,
    /// Workers that did not come home at the end of the run.
    pub workers_hung: usize,
    /// Records that telemetry lost; with any, the figures of the control task are incomplete.
    pub lost_records: u64,
    /// Samples that could not be loaned or sent to every reader.
    pub send_failures: u64,
    /// Times that a reader, a writer or a client that joined could not be connected: no file descriptors
    /// were left, or memory could not be mapped.
    pub attach_failures: u64,
    /// The kernel.
    pub kernel: String,
    /// The processor.
    pub cpu: String,
}

impl Report {
    /// Whether all robots arrived, no clearance was violated, and every period is accounted for.
    pub fn success(&self) -> bool {
        self.control.arrived == self.control.robots && self.control.violations == 0 && self.lost_records == 0
    }
}

impl Report {
    /// What does not add up: counts that contradict each other. Empty for every sound report of a run
    /// without lost records, however it went.
    pub fn inconsistencies(&self) -> Vec<String> {
        let mut found = Vec::new();
        let mut check = |holds: bool, equation: &str, left: u64, right: u64| {
            if !holds {
                found.push(format!("{equation}: {left} and {right}"));
            }
        };
        let every_period = [
            ("release lateness", &self.release_lateness_ns),
            ("state published", &self.state_publish_ns),
            ("deadline lateness", &self.deadline_lateness_ns),
        ];
        for (name, times) in every_period {
            check(times.count == self.ticks, &format!("one {name} a period"), times.count, self.ticks);
        }
        let (commanded, published) = (self.state_to_command_ns.count, self.published_periods);
        check(commanded == published, "one state to command a published period", commanded, published);
        check(published <= self.ticks, "published and all periods", published, self.ticks);
        let unpublished = self.ticks.saturating_sub(published);
        check(
            unpublished <= self.deadline_misses,
            "unpublished and missed",
            unpublished,
            self.deadline_misses,
        );
        let answers = self.ticks * self.workers as u64;
        check(
            self.state_to_worker_ns.count <= answers,
            "answers of workers",
            self.state_to_worker_ns.count,
            answers,
        );
        check(
            self.state_to_staged_ns.count <= self.ticks,
            "periods staged",
            self.state_to_staged_ns.count,
            self.ticks,
        );
        check(
            self.solve_ns.count == self.step_ns.count,
            "solves and steps",
            self.solve_ns.count,
            self.step_ns.count,
        );
        let steps = self.ticks * self.control.robots as u64;
        check(self.solve_ns.count <= steps, "solves of robots", self.solve_ns.count, steps);
        let stops = self.stops.values().sum();
        check(stops <= self.fallback_commands, "stops by reason", stops, self.fallback_commands);
        let (missed, skipped) = (self.deadline_misses, self.skipped_periods);
        check(skipped <= missed, "skipped and missed periods", skipped, missed);
        check(missed <= skipped + self.ticks, "missed and all periods", missed, skipped + self.ticks);
        if missed == 0 && self.worker_panics == 0 && self.lost_records == 0 {
            let staged = self.state_to_staged_ns.count;
            check(staged == self.ticks, "every period staged", staged, self.ticks);
            check(stops == self.fallback_commands, "every stop has a reason", stops, self.fallback_commands);
            let answered = self.state_to_worker_ns.count;
            check(answered == answers, "every worker answered", answered, answers);
        }
        for (name, times) in every_period
            .into_iter()
            .chain([("state to command", &self.state_to_command_ns)])
            .chain([("solve", &self.solve_ns), ("step", &self.step_ns)])
        {
            let ordered = [times.p50, times.p99, times.p999, times.max].is_sorted();
            check(ordered, &format!("percentiles of {name}"), times.p50, times.max);
        }
        check(self.lost_records == 0, "records lost", self.lost_records, 0);
        found
    }
}

/// The kernel's name and release.
pub fn kernel() -> String {
    let uname = rustix::system::uname();
    let part = |text: &std::ffi::CStr| text.to_string_lossy().into_owned();
    format!("{} {} {}", part(uname.sysname()), part(uname.release()), part(uname.version()))
}

/// The processor's name.
pub fn cpu() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split_once(':'));
    let name = name.map_or(std::env::consts::ARCH, |(_, name)| name.trim());
    let count = info.lines().filter(|line| line.starts_with("processor")).count();
    format!("{count} × {name}")
}
