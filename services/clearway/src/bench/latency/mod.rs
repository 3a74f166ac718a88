//! `clearway bench latency`: how late, how long, on this machine.

mod child;
mod control;
mod cyclictest;
mod figure;
mod load;
mod pattern;
mod plan;
mod release;
mod report;
mod transfer;
mod world;

pub(crate) use child::{ProcessArgs, run as run_process};

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use clap::ValueEnum;
use clap::builder::RangedU64ValueParser;
use clearway::config::{PublishAt, Wakeup};
use clearway::realtime::{Achieved, Awake, lock_memory, stay_awake};
use indicatif::ProgressBar;
use miette::{Result, miette};

use super::machine::Machine;
use crate::host::Host;
use load::Load;
use plan::Seats;
use report::{DaemonFigures, Distributions, Figures, HostFacts, Measured, Report, Target};
use world::{Interrupt, Turn, World};

/// Robots of the samples.
const ROBOTS: usize = 8;
const TRANSFER_FLEET: &str = "transfer";
const CONTROL_FLEET: &str = "control";
/// Transfers of each kind.
const TRANSFERS: u64 = 20_000;

/// Measure release lateness, channel latency and state → command on this machine.
///
/// Under each load (nothing; a busy other CPU; memory traffic; a process that joins and leaves the
/// channels) it measures how late a period is released, how long a state takes to another process and
/// to another thread, and how long the daemon's own code takes from a state to its commands in another
/// process. Full histograms, with what the kernel granted. Figures are called real-time only when every
/// scheduling, affinity and locking call was granted.
///
/// Takes about a minute; --samples and --load say how long.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway bench latency
  clearway bench latency --period-us 500 --cpu 1 --json out.json --svg out.svg
  clearway bench latency --samples 60000 --load idle --against cyclictest

Exit codes: 0 measured in real time, 1 measured, but something was refused and the figures are best
effort, 2 the command line is wrong, nothing could be measured, or interrupted.")]
pub(crate) struct Args {
    /// Period, µs.
    #[arg(long, value_name = "P", default_value = "2000", value_parser = RangedU64ValueParser::<u64>::new().range(200..=1_000_000))]
    period_us: u64,
    /// Periods of each part; as many as 6 s hold unless given.
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(20..=100_000_000))]
    samples: Option<u64>,
    /// SCHED_FIFO priority of the release and of the daemon's loop; workers run one below, the reader two.
    #[arg(long, value_name = "1..99", default_value = "80", value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: u8,
    /// CPU of the release and of the daemon's loop; the first usable one unless given.
    #[arg(long, value_name = "C")]
    cpu: Option<usize>,
    /// CPU of the reader in another process; a third one where there is one, otherwise the worker's.
    #[arg(long, value_name = "C")]
    reader_cpu: Option<usize>,
    /// Loads to measure under.
    #[arg(long, value_name = "LOAD,LOAD,…", value_delimiter = ',', value_enum)]
    load: Vec<Load>,
    /// How the daemon's threads wait for each other: futex, spin or channel.
    #[arg(long, value_name = "HOW", default_value_t)]
    wakeup: Wakeup,
    /// When the daemon publishes commands: complete or deadline.
    #[arg(long, value_name = "WHEN", default_value_t)]
    publish: PublishAt,
    /// Measure the releases of another program in turns with ours, and print the ratio.
    #[arg(long, value_name = "PROGRAM", value_enum)]
    against: Option<Rival>,
    /// Do not measure unless every real-time call is granted.
    #[arg(long)]
    require: bool,
    /// Write the report to this file; `-` for standard output instead of the tables.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Draw the distributions to this file.
    #[arg(long, value_name = "OUT.svg")]
    svg: Option<PathBuf>,
}

/// What can be measured against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Rival {
    /// The one of rt-tests.
    Cyclictest,
}

/// Everything that the parts need.
struct Bench<'a> {
    args: &'a Args,
    period_ns: u64,
    samples: u64,
    loads: Vec<Load>,
    seats: Seats,
    world: World,
    interrupt: Interrupt,
    _turn: Turn,
    /// As for a daemon, while anything is measured.
    _awake: Option<Awake>,
    realtime: Achieved,
    bar: ProgressBar,
}

/// Whether everything was granted.
pub(crate) fn run(args: &Args) -> Result<bool> {
    if args.against.is_some() {
        cyclictest::version()?;
    }
    let mut bench = Bench::new(args)?;
    bench.announce();
    let measured =
        bench.loads.clone().into_iter().map(|load| bench.under(load)).collect::<Result<Vec<_>>>()?;
    bench.tell("iceoryx2's ping-pong");
    let against_iceoryx2 = if bench.seats.other.is_some() {
        Some(pattern::compare(&bench.world, &bench.seats, args.priority, &bench.interrupt)?)
    } else {
        None
    };
    let against_cyclictest = args.against.map(|_| bench.beside_cyclictest()).transpose()?;
    bench.bar.finish_and_clear();

    let granted = bench.realtime.degraded.is_empty();
    let first = measured.first().ok_or_else(|| miette!("no load to measure under"))?;
    let report = Report {
        label: if granted { report::REAL_TIME } else { report::BEST_EFFORT },
        period_ns: bench.period_ns,
        samples: bench.samples,
        realtime: bench.realtime.clone(),
        reader_cpu: bench.seats.reader,
        wakeup: args.wakeup.name(),
        publish: args.publish.name(),
        machine: Machine::here(),
        host: HostFacts::here(),
        method: report::METHOD,
        figures: first.figures.clone(),
        target: Target::of(&first.figures),
        against_iceoryx2,
        against_cyclictest,
        loads: measured,
    };
    if let Some(path) = &args.svg {
        let theirs = report.against_cyclictest.as_ref().map(|c| &c.theirs);
        let period_us = args.period_us as f64;
        super::write(path, &figure::svg(&report.loads, period_us, theirs))?;
    }
    super::hand_out(args.json.as_deref(), &report, || report.table())?;
    Ok(granted)
}

impl<'a> Bench<'a> {
    fn new(args: &'a Args) -> Result<Self> {
        let period_ns = args.period_us * 1000;
        let interrupt = Interrupt::listen()?;
        let turn = Turn::wait(&interrupt)?;
        let loads = if args.load.is_empty() { Load::ALL.to_vec() } else { args.load.clone() };
        let mut realtime = Achieved::default();
        // Before any thread starts, and before anything is measured.
        let asked = plan::asked(args.priority, args.wakeup);
        realtime.add_memory(lock_memory(&asked));
        let awake = realtime.add_awake(stay_awake(&asked));
        let seats = Seats::new(args.cpu, args.reader_cpu)?;
        let (priority, cpu) = (args.priority, seats.own);
        // A try, so that what is refused is known before a minute is spent.
        let grant = std::thread::spawn(move || plan::enter_real_time(priority, Some(cpu))).join();
        realtime.add_thread(grant.map_err(|_| miette!("the thread that asked for real time panicked"))?);
        if seats.other.is_none() {
            let alone = "one CPU only: the daemon, its reader and every load share it; give this process two";
            realtime.degraded.push(alone.to_owned());
        }
        if args.require && !realtime.degraded.is_empty() {
            let reasons = realtime.degraded.join("; ");
            return Err(miette!(
                help = "`clearway doctor` says what to change; without --require the figures are labelled best effort",
                "real time was refused: {reasons}"
            ));
        }
        Ok(Self {
            args,
            period_ns,
            samples: args.samples.unwrap_or_else(|| plan::samples(period_ns)),
            bar: super::bar(4 * loads.len() + 1),
            loads,
            seats,
            world: World::new()?,
            interrupt,
            _turn: turn,
            _awake: awake,
            realtime,
        })
    }

    /// What is going to happen and how long it takes.
    fn announce(&self) {
        let part = plan::duration(self.period_ns, self.samples);
        let parts = u32::try_from(2 * self.loads.len()).unwrap_or(u32::MAX);
        let beside = if self.args.against.is_some() { part * 2 } else { Duration::ZERO };
        let about = part * parts + beside + Duration::from_secs(2);
        eprintln!(
            "clearway bench latency: {} samples of {} µs under {}, about {} s",
            self.samples,
            self.args.period_us,
            self.loads.iter().map(|load| load.name()).collect::<Vec<_>>().join(", "),
            about.as_secs()
        );
        for refused in &self.realtime.degraded {
            eprintln!("refused: {refused}");
        }
        if Host::here().hypervisor().is_some() {
            eprintln!(
                "warning: a virtual machine; its host may stop it at any time, and tails are the host's"
            );
        }
    }

    fn tell(&self, what: &str) {
        self.bar.set_message(what.to_owned());
        self.bar.inc(1);
    }

    fn refuse(&mut self, refused: Vec<String>) {
        for reason in refused {
            if !self.realtime.degraded.contains(&reason) {
                self.realtime.degraded.push(reason);
            }
        }
    }

    /// All parts under one load.
    fn under(&mut self, load: Load) -> Result<Measured> {
        let args = self.args;
        let part = plan::duration(self.period_ns, self.samples + 10);
        let disturbing = load.start(&self.world, &self.seats, part * 2 + Duration::from_secs(120))?;

        self.tell(&format!("{}: release", load.name()));
        let releases =
            release::measure(self.period_ns, self.samples, args.priority, self.seats.own, &self.interrupt)?;
        self.interrupt.check()?;
        self.refuse(releases.grant.refused);

        self.tell(&format!("{}: transfers", load.name()));
        let transfers = TRANSFERS.max(self.samples.min(10 * TRANSFERS));
        let (seats, world) = (&self.seats, &self.world);
        let (other, own) = if seats.other.is_some() {
            let other = transfer::to_process(world, seats, args.priority, transfers, &self.interrupt)?;
            let own = transfer::to_thread(world, seats, args.priority, transfers, &self.interrupt)?;
            (other, own)
        } else {
            (transfer::Transfers::none()?, transfer::Transfers::none()?)
        };
        self.interrupt.check()?;
        self.refuse(other.refused);
        self.refuse(own.refused);

        self.tell(&format!("{}: state → command", load.name()));
        let setting = control::Setting {
            period_ns: self.period_ns,
            samples: self.samples,
            priority: args.priority,
            wakeup: args.wakeup,
            publish: args.publish,
        };
        let controlled = control::measure(&self.world, &self.seats, setting, &self.interrupt)?;
        self.refuse(controlled.refused);
        let daemon = controlled.report;
        self.refuse(daemon.realtime.degraded.clone());
        // The loop's first, then the workers'.
        self.realtime.cpus.clone_from(&daemon.realtime.cpus);

        self.tell(&format!("{}: done", load.name()));
        let rounds =
            disturbing.map(child::Child::finish).transpose()?.map_or(0, |found| found.count("rounds"));
        let measured = Measured {
            load: load.name(),
            description: load.description(),
            rounds,
            figures: Figures::default(),
            skipped_periods: releases.skipped,
            transfers_lost: other.lost + own.lost,
            commands_missed: controlled.missed,
            commands_expired: controlled.expired,
            daemon: DaemonFigures {
                release_lateness_ns: daemon.release_lateness_ns,
                state_publish_ns: daemon.state_publish_ns,
                state_to_worker_ns: daemon.state_to_worker_ns,
                state_to_staged_ns: daemon.state_to_staged_ns,
                state_to_command_ns: daemon.state_to_command_ns,
                skipped_periods: daemon.skipped_periods,
                deadline_misses: daemon.deadline_misses,
                realtime: daemon.realtime,
            },
            histograms: BTreeMap::new(),
            distributions: Distributions {
                release_lateness: releases.lateness,
                channel: other.state,
                channel_command: other.command,
                channel_own_process: own.state,
                state_to_command: controlled.state_to_command,
                command_to_reader: controlled.command_to_reader,
                step: controlled.step,
            },
        };
        Ok(measured.fill())
    }

    /// Releases in turns with cyclictest's, under the first load.
    fn beside_cyclictest(&self) -> Result<cyclictest::Comparison> {
        let setting = cyclictest::Setting {
            period_ns: self.period_ns,
            samples: self.samples,
            priority: self.args.priority,
            cpu: self.seats.own,
        };
        let limit = plan::duration(self.period_ns, self.samples * 3) + Duration::from_secs(60);
        let load = self.loads.first().copied().unwrap_or(Load::Idle);
        let disturbing = load.start(&self.world, &self.seats, limit)?;
        let compared = cyclictest::compare(&self.world, setting, &self.interrupt, |block, blocks| {
            self.bar.set_message(format!(
                "{}: beside cyclictest, block {} of {blocks}",
                load.name(),
                block + 1
            ));
        });
        disturbing.map(child::Child::finish).transpose()?;
        compared
    }
}
