//! `clearway figures`: the paper's figures and ours, from closed loops run on the spot.

mod cases;
mod curves;
mod data;
mod timelapse;
mod trajectories;

use crate::plot::Figure;
use cases::Case;
use clearway::config::Profile;
use clearway::controller::Timing;
use clearway::geometry::Integration;
use miette::{IntoDiagnostic, Result, WrapErr};
use std::path::{Path, PathBuf};

/// Draw the paper's Figs. 1 to 4 and ours as SVG.
///
/// Runs the position swap under all three control laws, with headings toward the goal, all zero, and
/// random, and draws trajectories (Fig. 1 under `exp`, Fig. 2 under `certified` and `paper`, with its
/// collisions marked), average inputs (Fig. 3), average distances to the goal (Fig. 4), the smallest
/// clearance over time, the Lyapunov values against the finite-time bound, and time-lapses. The same
/// files, to the byte, on every run.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway figures --out figures
  clearway figures --out figures --data                 CSV beside each figure
  clearway figures --out mine --scenario mine.toml      of your own scenario
  clearway figures --out paper --timing ideal --plant euler
                                                        as the paper simulated

Exit codes: 0 done, 2 the command line or a file is wrong.")]
pub(crate) struct Args {
    /// Folder for the figures; it is made where it does not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Scenarios to draw, built-in or files, up to three in a row, instead of the swap.
    #[arg(long)]
    scenario: Vec<String>,
    /// Seeds of the swap with random headings.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: u64,
    /// Write the data of each figure beside it as CSV, and every period of the runs as run-*.csv.
    #[arg(long)]
    data: bool,
    /// When a command acts: `let` one period after its state, as in the daemon; `ideal` at once.
    #[arg(long, default_value = "let")]
    timing: Timing,
    /// How the plant moves: `exact` along arcs; `euler` by forward Euler steps, as the paper's.
    #[arg(long, value_name = "exact|euler")]
    plant: Option<Integration>,
    /// A configuration key to change, as in a configuration file.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
    /// Runs at the same time; as many as there are cores by default.
    #[arg(long)]
    jobs: Option<std::num::NonZeroUsize>,
}

/// The laws in the order of every legend.
const LAWS: [Profile; 3] = [Profile::Certified, Profile::Exponential, Profile::Paper];

/// A law as it is called in figures.
fn law_name(profile: Profile) -> &'static str {
    match profile {
        Profile::Certified => "certified (finite time)",
        Profile::Exponential => "exp (exponential)",
        Profile::Paper => "paper (as printed)",
    }
}

pub(crate) fn run(args: &Args) -> Result<()> {
    std::fs::create_dir_all(&args.out)
        .into_diagnostic()
        .wrap_err_with(|| format!("{} cannot be made", args.out.display()))?;
    let cases = cases::run(args)?;

    let mut figures: Vec<(String, Figure)> = vec![
        ("fig1-trajectories-exp".into(), trajectories::figure(&cases, Profile::Exponential)),
        ("fig2-trajectories-certified".into(), trajectories::figure(&cases, Profile::Certified)),
        ("fig2-trajectories-paper".into(), trajectories::figure(&cases, Profile::Paper)),
        ("fig3-inputs".into(), curves::inputs(&cases)),
        ("fig4-distance".into(), curves::distance(&cases)),
        ("clearance".into(), curves::clearance(&cases)),
        ("lyapunov".into(), curves::lyapunov(&cases, args.timing)),
    ];
    let stills = cases.iter().map(|case| (format!("timelapse-{}", case.slug), timelapse::still(case)));
    figures.extend(stills);
    for (name, figure) in &figures {
        save(args, &format!("{name}.svg"), &figure.svg())?;
        if args.data {
            save(args, &format!("{name}.csv"), &figure.csv())?;
        }
    }
    for case in cases.iter().filter(|_| args.data) {
        for law in LAWS {
            save(args, &format!("run-{}-{law}.csv", case.slug), &data::csv(&case.under(law)[0]))?;
        }
    }
    for case in &cases {
        save(args, &format!("timelapse-{}-animated.svg", case.slug), &timelapse::animated(case))?;
    }
    Ok(())
}

fn save(args: &Args, name: &str, text: &str) -> Result<()> {
    let path: &Path = &args.out.join(name);
    std::fs::write(path, text)
        .into_diagnostic()
        .wrap_err_with(|| format!("{} cannot be written", path.display()))?;
    crate::show(&format!("{:>5} kB  {}\n", text.len().div_ceil(1000), path.display()));
    Ok(())
}

/// A figure with a column for each case.
fn columns(title: &str, cases: &[Case]) -> Figure {
    let columns = cases.len().clamp(1, 3);
    Figure::new(title).columns(columns).width([480.0, 760.0, 980.0][columns - 1])
}
