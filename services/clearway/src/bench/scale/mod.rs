//! `clearway bench scale`: whole periods of the daemon with fleets up to 100,000 robots.

mod carousel;
mod drive;
mod report;

use super::{bar, hand_out, write};
use drive::Drive;
use miette::{Result, miette};
use report::Curve;
use std::path::PathBuf;

/// Robots of a fleet at most.
const ROBOTS_MAX: usize = 100_000;

/// Time whole periods of large fleets: states in shared memory to commands published.
///
/// The daemon itself runs in real time, with its own period of 80 ms, its plant and its channels; the
/// figures come from its telemetry channel. The robots of `field-N-1` drive round and round on circular
/// streets of which they cover 7 %: each time one comes within 4 m of its goal it is sent 12 m further
/// along, to the lane beside its own. A period that is not answered at the deadline is published without
/// the commands that are missing and counts as a miss; its time is the deadline's, not what it would
/// have taken.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway bench scale --robots 1000
  clearway bench scale --robots 1000,3000,10000,30000 --plot scale.svg
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
    #[arg(long, value_name = "N", default_value = "75")]
    warm_up: u64,
    /// Write the report to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Draw the curve into this SVG file.
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(robots) = args.robots.iter().find(|n| !(1..=ROBOTS_MAX).contains(*n)) {
        return Err(miette!(
            help = format!("name numbers from 1 to {ROBOTS_MAX}"),
            "a fleet of {robots} robots"
        ));
    }
    let mut cases = Vec::new();
    for robots in &args.robots {
        let drive = Drive {
            robots: *robots,
            workers: args.workers.get(),
            warm_up: args.warm_up,
            periods: args.periods.get(),
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
