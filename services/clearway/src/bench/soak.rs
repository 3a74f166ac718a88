//! `clearway bench soak`: millions of periods, and whether memory and counters stay sound.

use clap::builder::RangedU64ValueParser;
use clearway::config::Config;
use clearway::report::Report;
use clearway::runtime::{Accelerated, Daemon, Until};
use clearway::scenario::Scenario;
use miette::{IntoDiagnostic, Result};
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What memory may grow by after the first tenth of a run, KiB: the allocator's slack, not a leak.
const GROWTH_MAX_KIB: u64 = 1024;
/// Looks at memory in a run.
const LOOKS: u64 = 10;

/// Run for very long and check that nothing grows, wears out or miscounts.
///
/// In virtual time the loop, a worker, housekeeping and a driver take turns in one thread, as fast as
/// the machine allows: observations are admitted, programmes solved, commands gated, figures kept, all
/// over shared memory. When everybody has arrived, starts and goals change places. In real time the
/// daemon itself runs. Both begin at `--first-tick`, so that numbers can be made large.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway bench soak --ticks 10000000
  clearway bench soak --ticks 100000 --first-tick 4294917296    across 2^32
  clearway bench soak --real-time --duration-s 600 --period-us 1000

Exit codes: 0 sound, 1 memory grew or counters contradict each other, 2 the
command line is wrong or the run could not start.")]
pub(crate) struct Args {
    /// Periods in virtual time.
    #[arg(long, value_name = "N", default_value = "1000000", conflicts_with = "real_time", value_parser = RangedU64ValueParser::<u64>::new().range(1..))]
    ticks: u64,
    /// Run the daemon in real time.
    #[arg(long)]
    real_time: bool,
    /// How long, s.
    #[arg(long, value_name = "S", default_value = "600", requires = "real_time", value_parser = RangedU64ValueParser::<u64>::new().range(1..=10_000_000))]
    duration_s: u64,
    /// Period, µs. In virtual time 80000 unless given; in real time 1000.
    #[arg(long, value_name = "T", value_parser = RangedU64ValueParser::<u64>::new().range(200..=1_000_000))]
    period_us: Option<u64>,
    /// Scenario, a built-in name or a file.
    #[arg(long, value_name = "NAME", default_value = "swap8")]
    scenario: String,
    /// Number of the first period.
    #[arg(long, value_name = "K", default_value = "0")]
    first_tick: u64,
    /// Write the report to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

/// What a soak found.
#[derive(Debug, Serialize)]
struct Soak {
    cpu: String,
    kernel: String,
    scenario: String,
    real_time: bool,
    period_us: u64,
    first_tick: u64,
    wall_s: f64,
    /// Memory in use: periods so far and resident memory, KiB.
    resident_kib: Vec<(u64, u64)>,
    /// Growth after the first tenth, KiB.
    growth_kib: u64,
    /// Times that everybody arrived; null in real time.
    laps: Option<u64>,
    /// What does not add up.
    inconsistencies: Vec<String>,
    report: Report,
}

pub(crate) fn run(args: &Args) -> Result<bool> {
    let mut config = Config::new(Scenario::resolve(&args.scenario)?);
    config.channel = config.channel.with_environment();
    config.fleet = format!("soak-{}", std::process::id());
    let period_us = args.period_us.unwrap_or(if args.real_time { 1000 } else { 80_000 });
    config.timing.period_ns = period_us * 1000;
    config.timing.first_tick = args.first_tick;
    let mut soak = if args.real_time { real_time(args, config)? } else { virtual_time(args, config)? };
    if soak.growth_kib > GROWTH_MAX_KIB {
        let grown = format!("memory grew by {} KiB after the first tenth of the run", soak.growth_kib);
        soak.inconsistencies.push(grown);
    }
    super::hand_out(args.json.as_deref(), &soak, || table(&soak))?;
    Ok(soak.inconsistencies.is_empty())
}

/// Looks at memory a number of times over a run of `total` periods.
struct Memory {
    total: u64,
    looks: Vec<(u64, u64)>,
}

impl Memory {
    fn new(total: u64) -> Self {
        Self { total, looks: vec![(0, resident_kib())] }
    }

    fn look(&mut self, done: u64) {
        let due = self.looks.len() as u64 * self.total / LOOKS;
        if done >= due.max(1) && done < self.total {
            self.looks.push((done, resident_kib()));
        }
    }

    fn end(&mut self, done: u64) {
        self.looks.push((done, resident_kib()));
    }

    fn growth_kib(&self) -> u64 {
        let warm = self.looks.get(1).map_or(0, |(_, kib)| *kib);
        self.looks.iter().skip(1).map(|(_, kib)| kib.saturating_sub(warm)).max().unwrap_or(0)
    }
}

fn virtual_time(args: &Args, config: Config) -> Result<Soak> {
    let bar = super::bar(usize::try_from(args.ticks).unwrap_or(usize::MAX));
    let mut memory = Memory::new(args.ticks);
    let started = Instant::now();
    let (scenario, period_us) = (config.scenario.name.clone(), config.timing.period_ns / 1000);
    let robots = config.scenario.robots.len() as u64;
    // The largest tick that is released bounds the run.
    let ticks = args.ticks.min(clearway::schedule::TICK_MAX.saturating_sub(args.first_tick));
    let run = Accelerated::run(config, ticks, 1_000_000_000, |progress| {
        memory.look(progress.ticks);
        bar.set_position(progress.ticks);
    })
    .into_diagnostic()?;
    bar.finish_and_clear();
    memory.end(run.report.ticks);
    let report = run.report;
    let mut inconsistencies = report.inconsistencies();
    let mut equal = |what: &str, left: u64, right: u64| {
        if left != right {
            inconsistencies.push(format!("{what}: {left} and {right}"));
        }
    };
    equal("periods asked for and run", ticks, report.ticks);
    equal("observation samples, one a period and one at the end", run.observations, ticks + 1);
    equal("command samples, one a period, first and last", run.commands, ticks + 2);
    equal("commands refused by the gate", run.refused, 0);
    equal("observations refused", report.rejected_inputs.total(), 0);
    equal("a solve for each robot and period", report.solve_ns.count, ticks * robots);
    equal("stops", report.fallback_commands, 0);
    equal("late or skipped periods", report.deadline_misses, 0);
    equal("pairs too close", report.control.violations as u64, 0);
    Ok(Soak {
        cpu: clearway::report::cpu(),
        kernel: clearway::report::kernel(),
        scenario,
        real_time: false,
        period_us,
        first_tick: args.first_tick,
        wall_s: started.elapsed().as_secs_f64(),
        growth_kib: memory.growth_kib(),
        resident_kib: memory.looks,
        laps: Some(run.laps),
        inconsistencies,
        report,
    })
}

fn real_time(args: &Args, mut config: Config) -> Result<Soak> {
    let (scenario, period_us) = (config.scenario.name.clone(), config.timing.period_ns / 1000);
    let ticks = args.duration_s.saturating_mul(1_000_000) / period_us;
    config.timing.ticks = Some(ticks);
    let bar = super::bar(usize::try_from(ticks).unwrap_or(usize::MAX));
    let started = Instant::now();
    let daemon = Daemon::start(config, Until::Stopped).into_diagnostic()?;
    let mut memory = Memory::new(ticks);
    while !daemon.is_finished() {
        let progress = daemon.progress();
        memory.look(progress.ticks);
        bar.set_position(progress.ticks);
        std::thread::sleep(Duration::from_millis(100));
    }
    memory.end(daemon.progress().ticks);
    let report = daemon.join().into_diagnostic()?;
    bar.finish_and_clear();
    let mut inconsistencies = report.inconsistencies();
    // A run whose last periods are overslept as a whole ends without them.
    if report.ticks + report.skipped_periods > ticks || (report.skipped_periods == 0 && report.ticks != ticks)
    {
        let (run, skipped) = (report.ticks, report.skipped_periods);
        inconsistencies.push(format!("{run} periods run and {skipped} skipped do not make {ticks}"));
    }
    Ok(Soak {
        cpu: clearway::report::cpu(),
        kernel: clearway::report::kernel(),
        scenario,
        real_time: true,
        period_us,
        first_tick: args.first_tick,
        wall_s: started.elapsed().as_secs_f64(),
        growth_kib: memory.growth_kib(),
        resident_kib: memory.looks,
        laps: None,
        inconsistencies,
        report,
    })
}

/// Resident memory of this process, KiB; 0 where the kernel does not say.
fn resident_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|rest| rest.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

fn table(soak: &Soak) -> String {
    let mut out = String::new();
    let report = &soak.report;
    let time = if soak.real_time { "real" } else { "virtual" };
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{}\n{}", soak.cpu, soak.kernel);
    let _ = writeln!(
        out,
        "{}, {} periods of {} µs from {} in {time} time, {:.0} s\n",
        soak.scenario, report.ticks, soak.period_us, soak.first_tick, soak.wall_s
    );
    let _ = writeln!(out, "{:>14} {:>14}", "periods", "resident KiB");
    for (periods, kib) in &soak.resident_kib {
        let _ = writeln!(out, "{periods:>14} {kib:>14}");
    }
    let _ = writeln!(out);
    let mut line = |what: &str, count: u64| {
        let _ = writeln!(out, "{what:22} {count:>14}");
    };
    line("solves", report.solve_ns.count);
    line("stops", report.fallback_commands);
    line("missed periods", report.deadline_misses);
    line("skipped periods", report.skipped_periods);
    line("observations refused", report.rejected_inputs.total());
    line("records lost", report.lost_records);
    line("pairs too close", report.control.violations as u64);
    if let Some(laps) = soak.laps {
        line("laps", laps);
    }
    if soak.real_time {
        line("release p99.9, ns", report.release_lateness_ns.p999);
        line("release max, ns", report.release_lateness_ns.max);
    }
    if soak.inconsistencies.is_empty() {
        let _ = writeln!(out, "\nsound: memory is flat and the counters agree");
    }
    for found in &soak.inconsistencies {
        let _ = writeln!(out, "NOT SOUND: {found}");
    }
    out
}
