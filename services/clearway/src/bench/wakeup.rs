//! `clearway bench wakeup`: how long a worker takes to wake, and the loop after it.

use super::quantiles::Quantiles;
use clap::builder::RangedU64ValueParser;
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::{RealTimeConfig, Wakeup};
use clearway::realtime::{Role, Seat, enter, usable_cpus};
use clearway::report;
use clearway::runtime::{EventCount, Waiting};
use miette::Result;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// Measure how a loop and a worker wake each other.
///
/// Two threads, as the daemon starts them: SCHED_FIFO where it is granted, pinned. Once a period one
/// stamps the time and wakes the other, which stamps the time that it is awake and wakes the first.
/// Everything else is the daemon's own code.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway bench wakeup
  clearway bench wakeup --periods 20000 --period-us 500 --json wakeup.json

Exit codes: 0 measured, 2 the command line is wrong.")]
pub(crate) struct Args {
    /// Periods of each case.
    #[arg(long, value_name = "N", default_value = "5000", value_parser = RangedU64ValueParser::<u64>::new().range(1..=10_000_000))]
    periods: u64,
    /// Period, µs.
    #[arg(long, value_name = "T", default_value = "1000", value_parser = RangedU64ValueParser::<u64>::new().range(200..=1_000_000))]
    period_us: u64,
    /// Write the report to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

/// One way to wait, on one placement.
#[derive(Debug, Serialize)]
struct Case {
    wakeup: &'static str,
    /// CPU of the loop and of the worker.
    cpus: [usize; 2],
    /// Scheduling policy of both.
    policy: &'static str,
    /// What was refused.
    degraded: Vec<String>,
    /// From the loop's stamp to the worker being awake, ns.
    to_worker_ns: Quantiles,
    /// From the worker's stamp to the loop being awake, ns.
    to_loop_ns: Quantiles,
    /// CPU time of both threads for each period, ns.
    cpu_ns: f64,
}

/// The whole report.
#[derive(Debug, Serialize)]
struct Report {
    cpu: String,
    kernel: String,
    periods: u64,
    period_us: u64,
    cases: Vec<Case>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let cpus = usable_cpus();
    let (Some(&first), Some(&last)) = (cpus.first(), cpus.last()) else {
        return Err(miette::miette!("the kernel does not say which CPUs this process may use"));
    };
    let mut placements = vec![[first, last]];
    if first != last {
        placements.push([first, first]);
    }
    let bar = super::bar(placements.len() * Wakeup::ALL.len());
    let mut cases = Vec::new();
    for cpus in placements {
        for &wakeup in Wakeup::ALL {
            bar.set_message(format!("{wakeup}, CPUs {} and {}", cpus[0], cpus[1]));
            // Who shares a CPU does not spin.
            if wakeup != Wakeup::Spin || cpus[0] != cpus[1] {
                cases.push(measure(args, wakeup, cpus));
            }
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    let report = Report {
        cpu: report::cpu(),
        kernel: report::kernel(),
        periods: args.periods,
        period_us: args.period_us,
        cases,
    };
    super::hand_out(args.json.as_deref(), &report, || table(&report))
}

/// What one thread saw.
#[derive(Debug, Default)]
struct Seen {
    waits_ns: Vec<f64>,
    cpu_ns: f64,
    policy: &'static str,
    refused: Vec<String>,
}

/// The two threads' side of the daemon's board: the number of the period that was said last, and when.
struct Said {
    event: EventCount,
    period: AtomicU64,
    stamp_ns: AtomicU64,
}

impl Said {
    fn new(wakeup: Wakeup) -> Self {
        Self { event: EventCount::new(wakeup, 1), period: AtomicU64::new(0), stamp_ns: AtomicU64::new(0) }
    }

    fn say(&self, period: u64) {
        self.stamp_ns.store(MonotonicClock.now_ns(), Ordering::Relaxed);
        self.period.store(period, Ordering::Release);
        self.event.notify();
    }

    /// Waits until `period` is said; how long ago that was, ns.
    fn hear(&self, period: u64, wakeup: Wakeup, due_ns: u64) -> f64 {
        loop {
            let known = self.event.count();
            if self.period.load(Ordering::Acquire) >= period {
                let stamp_ns = self.stamp_ns.load(Ordering::Relaxed);
                return MonotonicClock.now_ns().saturating_sub(stamp_ns) as f64;
            }
            self.event.wait(&MonotonicClock, Waiting::new(wakeup, 0, due_ns), known, u64::MAX);
        }
    }
}

fn measure(args: &Args, wakeup: Wakeup, cpus: [usize; 2]) -> Case {
    let config = RealTimeConfig { wakeup, ..RealTimeConfig::default() };
    let seat = |cpu| Seat { cpu: Some(cpu), alone: cpus[0] != cpus[1] };
    let (released, staged) = (Said::new(wakeup), Said::new(wakeup));
    let period_ns = args.period_us * 1000;
    let start_ns = MonotonicClock.now_ns() + 20_000_000;
    let release_ns = |period: u64| start_ns + period * period_ns;
    let seen = |role, cpu, each: &dyn Fn(u64, Wakeup) -> f64| {
        let grant = enter(role, &config, seat(cpu));
        let before_ns = thread_cpu_ns();
        let waits_ns = (1..=args.periods).map(|period| each(period, grant.wakeup)).collect();
        Seen {
            waits_ns,
            cpu_ns: (thread_cpu_ns() - before_ns) / args.periods as f64,
            policy: grant.policy,
            refused: grant.refused,
        }
    };
    let (on_loop, on_worker) = std::thread::scope(|scope| {
        let on_loop = scope.spawn(|| {
            seen(Role::Loop, cpus[0], &|period, wakeup| {
                MonotonicClock.sleep_until(release_ns(period));
                released.say(period);
                staged.hear(period, wakeup, 0)
            })
        });
        let on_worker = scope.spawn(|| {
            seen(Role::Worker(0), cpus[1], &|period, wakeup| {
                let heard_ns = released.hear(period, wakeup, release_ns(period));
                staged.say(period);
                heard_ns
            })
        });
        (on_loop.join().unwrap_or_default(), on_worker.join().unwrap_or_default())
    });
    let mut degraded = on_loop.refused;
    degraded.extend(on_worker.refused);
    Case {
        wakeup: wakeup.name(),
        cpus,
        policy: if on_loop.policy == on_worker.policy { on_loop.policy } else { "mixed" },
        degraded,
        to_worker_ns: Quantiles::of(on_worker.waits_ns),
        to_loop_ns: Quantiles::of(on_loop.waits_ns),
        cpu_ns: on_loop.cpu_ns + on_worker.cpu_ns,
    }
}

/// CPU time that the calling thread has had, ns; 0 where the kernel does not say.
fn thread_cpu_ns() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|field| field.parse().ok()).unwrap_or(0.0)
}

fn table(report: &Report) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{}\n{}", report.cpu, report.kernel);
    let _ = writeln!(out, "{} periods of {} µs; times in µs\n", report.periods, report.period_us);
    let _ = writeln!(out, "{:16} {:^28} {:^28} {:>6}", "", "to the worker", "back to the loop", "CPU");
    let head = format!("{:>6} {:>6} {:>6} {:>7}", "p50", "p99", "p99.9", "max");
    let _ = writeln!(out, "{:8} {:7} {head} {head} {:>6}", "wake-up", "CPUs", "");
    for case in &report.cases {
        let times = |q: &Quantiles| {
            let us = [q.p50, q.p99, q.p999, q.max].map(|ns| ns * 1e-3);
            format!("{:6.1} {:6.1} {:6.1} {:7.1}", us[0], us[1], us[2], us[3])
        };
        let _ = writeln!(
            out,
            "{:8} {:7} {} {} {:6.1}",
            case.wakeup,
            format!("{}, {}", case.cpus[0], case.cpus[1]),
            times(&case.to_worker_ns),
            times(&case.to_loop_ns),
            case.cpu_ns * 1e-3
        );
    }
    let refused: std::collections::BTreeSet<&String> =
        report.cases.iter().flat_map(|c| &c.degraded).collect();
    for refused in refused {
        let _ = writeln!(out, "DEGRADED: {refused}");
    }
    out
}
