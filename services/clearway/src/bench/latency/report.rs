//! The report: as JSON, and as tables of 80 columns.

use std::collections::BTreeMap;
use std::fmt::Write;

use clearway::figures::{LatencyHistogram, LatencyNs};
use clearway::realtime::Achieved;
use serde::Serialize;

use super::{cyclictest, pattern};
use crate::bench::machine::Machine;
use crate::host::Host;

/// Quantiles beyond this many samples are the largest one and not shown.
const SAMPLES_FOR_P9999: u64 = 10_000;

/// Whether figures may be called real-time.
pub(super) const REAL_TIME: &str = "real time";
pub(super) const BEST_EFFORT: &str = "best effort";

/// The whole report.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    /// `real time`, or `best effort` when anything that was asked of the kernel was refused.
    pub(super) label: &'static str,
    pub(super) period_ns: u64,
    pub(super) samples: u64,
    pub(super) realtime: Achieved,
    pub(super) reader_cpu: Option<usize>,
    pub(super) wakeup: &'static str,
    pub(super) publish: &'static str,
    pub(super) machine: Machine,
    pub(super) host: HostFacts,
    pub(super) method: Method,
    /// The first load's; the others are under `loads`.
    #[serde(flatten)]
    pub(super) figures: Figures,
    pub(super) target: Target,
    pub(super) against_iceoryx2: Option<pattern::Comparison>,
    pub(super) against_cyclictest: Option<cyclictest::Comparison>,
    pub(super) loads: Vec<Measured>,
}

/// What the machine is like.
#[derive(Debug, Serialize)]
pub(super) struct HostFacts {
    clock: &'static str,
    clock_source: Option<String>,
    hypervisor: Option<String>,
    governors: Vec<String>,
    isolated_cpus: Option<String>,
}

impl HostFacts {
    pub(super) fn here() -> Self {
        let host = Host::here();
        Self {
            clock: "CLOCK_MONOTONIC",
            clock_source: host.clock_source(),
            hypervisor: host.hypervisor(),
            governors: host.governors(),
            isolated_cpus: host.read("/sys/devices/system/cpu/isolated"),
        }
    }
}

/// How each figure was taken.
#[derive(Debug, Serialize)]
pub(super) struct Method {
    release_lateness_ns: &'static str,
    channel_ns: &'static str,
    channel_command_ns: &'static str,
    channel_own_process_ns: &'static str,
    state_to_command_ns: &'static str,
    command_to_reader_ns: &'static str,
    step_ns: &'static str,
    quantiles: &'static str,
}

pub(super) const METHOD: Method = Method {
    release_lateness_ns: "a thread set up as the daemon's loop sleeps to absolute times with clock_nanosleep; from the \
                          scheduled time to the first reading of the clock after the sleep, whole periods included",
    channel_ns: "a state of 8 robots from this process to another one that polls, back to back; from the writer's \
                 stamp before it fills the sample to the reader's reading of the clock; without the first 100",
    channel_command_ns: "the answer: commands for 8 robots, as channel_ns",
    channel_own_process_ns: "as channel_ns, to another thread of this process",
    state_to_command_ns: "the daemon's own loop and one worker in this process, 8 robots that drive; from the stamp of \
                          the state (the loop awake) to a reader in another process having the commands that answer \
                          it; the reader polls from 100 µs (at most a quarter of the period) before they can come",
    command_to_reader_ns: "the same samples; from the stamp of the commands, before they are sent",
    step_ns: "the worker's whole decision for all of its robots, in the same run",
    quantiles: "nearest rank, from a histogram of three significant digits; the clock's own cost is under \
                machine.clock_ns and part of every figure",
};

/// The figures of one load.
#[derive(Debug, Clone, Default, Serialize)]
#[expect(clippy::struct_field_names, reason = "the unit is part of the name")]
pub(super) struct Figures {
    pub(super) release_lateness_ns: LatencyNs,
    pub(super) channel_ns: LatencyNs,
    pub(super) channel_command_ns: LatencyNs,
    pub(super) channel_own_process_ns: LatencyNs,
    pub(super) state_to_command_ns: LatencyNs,
    pub(super) command_to_reader_ns: LatencyNs,
    pub(super) step_ns: LatencyNs,
}

/// The histograms of one load.
#[derive(Debug)]
pub(super) struct Distributions {
    pub(super) release_lateness: LatencyHistogram,
    pub(super) channel: LatencyHistogram,
    pub(super) channel_command: LatencyHistogram,
    pub(super) channel_own_process: LatencyHistogram,
    pub(super) state_to_command: LatencyHistogram,
    pub(super) command_to_reader: LatencyHistogram,
    pub(super) step: LatencyHistogram,
}

impl Distributions {
    fn named(&self) -> [(&'static str, &LatencyHistogram); 7] {
        [
            ("release_lateness_ns", &self.release_lateness),
            ("channel_ns", &self.channel),
            ("channel_command_ns", &self.channel_command),
            ("channel_own_process_ns", &self.channel_own_process),
            ("state_to_command_ns", &self.state_to_command),
            ("command_to_reader_ns", &self.command_to_reader),
            ("step_ns", &self.step),
        ]
    }
}

/// The daemon's own account of the run behind `state_to_command_ns`.
#[derive(Debug, Serialize)]
pub(super) struct DaemonFigures {
    pub(super) release_lateness_ns: LatencyNs,
    pub(super) state_publish_ns: LatencyNs,
    pub(super) state_to_worker_ns: LatencyNs,
    pub(super) state_to_staged_ns: LatencyNs,
    pub(super) state_to_command_ns: LatencyNs,
    pub(super) skipped_periods: u64,
    pub(super) deadline_misses: u64,
    pub(super) realtime: Achieved,
}

/// One load.
#[derive(Debug, Serialize)]
pub(super) struct Measured {
    pub(super) load: &'static str,
    pub(super) description: &'static str,
    /// How often the load did what it does: rounds of its loop, copies, visits.
    pub(super) rounds: u64,
    #[serde(flatten)]
    pub(super) figures: Figures,
    pub(super) skipped_periods: u64,
    pub(super) transfers_lost: u64,
    pub(super) commands_missed: u64,
    /// Seen when they were no longer valid, and not timed.
    pub(super) commands_expired: u64,
    pub(super) daemon: DaemonFigures,
    /// Upper end of each step, ns, and its count.
    pub(super) histograms: BTreeMap<&'static str, Vec<(u64, u64)>>,
    #[serde(skip)]
    pub(super) distributions: Distributions,
}

impl Measured {
    pub(super) fn fill(mut self) -> Self {
        let d = &self.distributions;
        self.figures = Figures {
            release_lateness_ns: d.release_lateness.summary(),
            channel_ns: d.channel.summary(),
            channel_command_ns: d.channel_command.summary(),
            channel_own_process_ns: d.channel_own_process.summary(),
            state_to_command_ns: d.state_to_command.summary(),
            command_to_reader_ns: d.command_to_reader.summary(),
            step_ns: d.step.summary(),
        };
        self.histograms = d.named().into_iter().map(|(name, h)| (name, h.steps().collect())).collect();
        self
    }
}

/// State → command against the least that it can be made of, medians, ns.
#[derive(Debug, Serialize)]
pub(super) struct Target {
    state_one_way_ns: u64,
    command_one_way_ns: u64,
    step_ns: u64,
    /// The sum of the three.
    sum_ns: u64,
    state_to_command_ns: u64,
    /// The last over the sum; the aim is 2 at most, polled.
    pub(super) ratio: f64,
}

impl Target {
    pub(super) fn of(figures: &Figures) -> Self {
        let parts = [figures.channel_ns.p50, figures.channel_command_ns.p50, figures.step_ns.p50];
        let sum_ns: u64 = parts.iter().sum();
        Self {
            state_one_way_ns: parts[0],
            command_one_way_ns: parts[1],
            step_ns: parts[2],
            sum_ns,
            state_to_command_ns: figures.state_to_command_ns.p50,
            ratio: figures.state_to_command_ns.p50 as f64 / sum_ns.max(1) as f64,
        }
    }
}

/// A figure's name, and where it is.
type Row = (&'static str, fn(&Figures) -> &LatencyNs);

impl Report {
    /// Tables for a terminal.
    pub(super) fn table(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail, here and below.
        let _ = writeln!(out, "{}", wrapped(&self.heading()));
        for refused in &self.realtime.degraded {
            let _ = writeln!(out, "{}", wrapped(&format!("REFUSED: {refused}")));
        }
        if self.host.hypervisor.is_some() {
            let note = "A virtual machine: its host may stop it at any time, and the tails and maxima are the \
                        host's. Take medians and ratios.";
            let _ = writeln!(out, "{}", wrapped(note));
        }
        let rows: [Row; 7] = [
            ("release lateness", |f| &f.release_lateness_ns),
            ("state, one way to another process", |f| &f.channel_ns),
            ("commands, one way to another process", |f| &f.channel_command_ns),
            ("state, one way to another thread", |f| &f.channel_own_process_ns),
            ("the control step, 8 robots", |f| &f.step_ns),
            ("state → command in another process", |f| &f.state_to_command_ns),
            ("command → reader in another process", |f| &f.command_to_reader_ns),
        ];
        for (name, figure) in rows {
            let _ = writeln!(
                out,
                "\n{name}, µs\n  {:<8}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}",
                "", "p50", "p90", "p99", "p99.9", "p99.99", "max", "count"
            );
            for run in &self.loads {
                let _ = writeln!(out, "{}", row(run.load, figure(&run.figures)));
            }
        }
        for run in self.loads.iter().filter(|run| run.troubled()) {
            let _ = writeln!(
                out,
                "\n{}: {} releases skipped, {} transfers lost, {} commands not seen,\n  {} seen too late; in the \
                 daemon {} periods skipped and {} deadlines missed",
                run.load,
                run.skipped_periods,
                run.transfers_lost,
                run.commands_missed,
                run.commands_expired,
                run.daemon.skipped_periods,
                run.daemon.deadline_misses
            );
        }
        let t = &self.target;
        let sum = format!(
            "State → command, median: {} µs, {:.2} times the sum of two transfers and the control step ({} + {} + {} \
             µs); the aim is 2 at most when threads poll, which --wakeup spin measures.",
            us(t.state_to_command_ns),
            t.ratio,
            us(t.state_one_way_ns),
            us(t.command_one_way_ns),
            us(t.step_ns)
        );
        let _ = writeln!(out, "\n{}", wrapped(&sum));
        self.comparisons(&mut out);
        out
    }

    fn heading(&self) -> String {
        let r = &self.realtime;
        let cpu = |cpu: Option<usize>| cpu.map_or("any".to_owned(), |cpu| cpu.to_string());
        let label = if self.label == REAL_TIME { "REAL TIME" } else { "BEST EFFORT, NOT REAL TIME" };
        format!(
            "{label}: policy {}, priority {}, CPU {} (release, loop), {} (worker, loads), {} (reader), memory {}; \
             period {} µs, {} samples; wake-up {}, published when {}; {}, {}, clock {}",
            r.policy,
            r.priority,
            cpu(r.cpus.first().copied().flatten()),
            cpu(r.cpus.get(1).copied().flatten()),
            cpu(self.reader_cpu),
            if r.memory_locked { "locked" } else { "not locked" },
            self.period_ns / 1000,
            self.samples,
            self.wakeup,
            self.publish,
            self.machine.cpu,
            self.machine.kernel,
            self.host.clock_source.as_deref().unwrap_or("unknown"),
        )
    }

    fn comparisons(&self, out: &mut String) {
        if let Some(c) = &self.against_iceoryx2 {
            let text = format!(
                "iceoryx2's own ping-pong, 1 KiB: {:.0} ns plain, {:.0} ns over our channels, which also write the \
                 sample: ratio {:.2}.",
                c.iceoryx2_ns, c.clearway_ns, c.ratio
            );
            let _ = writeln!(out, "{}", wrapped(&text));
        }
        if let Some(c) = &self.against_cyclictest {
            let _ = writeln!(
                out,
                "\nrelease lateness beside cyclictest, {} blocks in turns, µs\n  {:<8}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}",
                c.blocks, "", "p50", "p90", "p99", "p99.9", "p99.99", "max", "count"
            );
            let _ = writeln!(out, "{}", row("ours", &c.release_lateness_ns));
            let _ = writeln!(out, "{}", row("theirs", &c.cyclictest_ns));
            let (r, [low, high]) = (&c.ratio, c.ratio_p999_interval);
            let _ = writeln!(
                out,
                "  {:<8}{:>9.2}{:>9}{:>9.2}{:>9.2}{:>9}{:>9.2}\n  p99.9: 90 % of resampled ratios between {low:.2} and \
                 {high:.2}",
                "ratio", r.p50, "", r.p99, r.p999, "", r.max
            );
        }
    }
}

impl Measured {
    fn troubled(&self) -> bool {
        let counts = [
            self.skipped_periods,
            self.transfers_lost,
            self.commands_missed,
            self.commands_expired,
            self.daemon.skipped_periods,
            self.daemon.deadline_misses,
        ];
        counts.iter().any(|count| *count > 0)
    }
}

fn row(name: &str, l: &LatencyNs) -> String {
    if l.count == 0 {
        return format!("  {name:<8}{:>9}", "none");
    }
    let p9999 = if l.count < SAMPLES_FOR_P9999 { "-".to_owned() } else { us(l.p9999) };
    format!(
        "  {name:<8}{:>9}{:>9}{:>9}{:>9}{p9999:>9}{:>9}{:>9}",
        us(l.p50),
        us(l.p90),
        us(l.p99),
        us(l.p999),
        us(l.max),
        l.count
    )
}

/// Microseconds, three digits that count.
fn us(ns: u64) -> String {
    let us = ns as f64 / 1e3;
    match us {
        ..10.0 => format!("{us:.2}"),
        ..100.0 => format!("{us:.1}"),
        _ => format!("{us:.0}"),
    }
}

fn wrapped(text: &str) -> String {
    textwrap::fill(text, textwrap::Options::new(80).subsequent_indent("  "))
}
