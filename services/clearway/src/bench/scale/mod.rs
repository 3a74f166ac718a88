//! `clearway bench scale`: whole periods of the daemon with fleets up to 100,000 robots.

mod carousel;
mod drive;
mod memory;
mod report;

use super::{bar, hand_out, write};
use drive::Drive;
use miette::{Result, miette};
use report::Curve;
use std::num::NonZeroU64;
use std::path::PathBuf;

/// Robots of a fleet at most.
const ROBOTS_MAX: usize = 100_000;

/// Time whole periods of large fleets: states in shared memory to commands published.
///
/// The daemon itself runs in real time, with its own period of 80 ms, its plant and its channels; the
/// figures come from its telemetry channel. The robots of `field-N-1` drive round and round on circular
/// streets of which they cover 7 %: each time one comes within 4 m of its goal it is sent 12 m further
/// along, to the lane beside its own.
///
/// A fleet whose step may not fit into a period is driven with time passing slower (`slowdown`), so that
/// no step is cut off: everything computed stays as it is, and the times are the machine's. Misses are
/// the timed steps that took longer than 80 ms. Of steps that are cut off even so, only a lower bound is
/// known, and `cut off` counts them.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway bench scale --robots 1000
  clearway bench scale --robots 1000,10000,100000 --periods 60 --plot scale.svg
  clearway bench scale --robots 100000 --workers 8 --json scale.json

Exit codes: 0 measured, 2 the command line is wrong or the daemon cannot run.")]
pub(crate) struct Args {
    /// Robots; several numbers for a curve.
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', default_value = "100000")]
    robots: Vec<usize>,
    /// Workers.
    #[arg(long, value_name = "W", default_value = "2")]
    workers: std::num::NonZeroUsize,
    /// Periods that are timed.
    #[arg(long, value_name = "N", default_value = "300")]
    periods: std::num::NonZeroU64,
    /// Periods before, until the traffic is steady.
    #[arg(long, value_name = "N", default_value = "30")]
    warm_up: u64,
    /// How much slower time passes; 0 for 1 where 80 ms should be enough, and more where they may not.
    #[arg(long, value_name = "S", default_value = "0")]
    slowdown: u64,
    /// Write the report to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Draw the curve into this SVG file.
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
}

/// Processor time that a robot may take on a busy machine, ns: for choosing a slowdown only.
const GENEROUS_NS: u64 = 16_000;
const PERIOD_NS: u64 = 80_000_000;

/// So much slower that the step fits in any case.
fn slowdown(asked: u64, robots: usize, workers: usize) -> NonZeroU64 {
    let needed = || (robots as u64 * GENEROUS_NS / workers.max(1) as u64).div_ceil(PERIOD_NS);
    NonZeroU64::new(asked).or_else(|| NonZeroU64::new(needed())).unwrap_or(NonZeroU64::MIN)
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(robots) = args.robots.iter().find(|n| !(1..=ROBOTS_MAX).contains(*n)) {
        return Err(miette!(
            help = format!("name numbers from 1 to {ROBOTS_MAX}"),
            "a fleet of {robots} robots"
        ));
    }
    let copy_bytes_per_s = memory::copy_bytes_per_s(args.workers.get());
    let mut cases = Vec::new();
    for robots in &args.robots {
        let drive = Drive {
            robots: *robots,
            workers: args.workers.get(),
            warm_up: args.warm_up,
            periods: args.periods.get(),
            slowdown: slowdown(args.slowdown, *robots, args.workers.get()),
            copy_bytes_per_s,
        };
        let bar = bar(usize::try_from(drive.warm_up + drive.periods).unwrap_or(usize::MAX));
        bar.set_message(format!("{robots} robots"));
        cases.push(drive.run(|tick| bar.set_position(tick))?);
        bar.finish_and_clear();
    }
    let curve = Curve { cases };
    if let Some(path) = &args.plot {
        write(path, &curve.svg())?;
    }
    match curve.cases.as_slice() {
        [one] => hand_out(args.json.as_deref(), one, || curve.table()),
        _ => hand_out(args.json.as_deref(), &curve, || curve.table()),
    }
}
