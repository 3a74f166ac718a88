use crate::summary;
use clearway::config::Checked;
use clearway::document::ConfigError;

/// Check a configuration or a scenario, and say what was understood.
///
/// Nothing is started. Every problem found is shown with its line and what to change.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway check clearway.toml
  clearway check docs/examples/crossing.toml
  clearway check random-20-7

Exit codes: 0 sound, 2 not.")]
pub(crate) struct Args {
    /// A configuration file, a scenario file or the name of a built-in scenario.
    file: String,
}

pub(crate) fn run(args: &Args) -> Result<(), ConfigError> {
    let (kind, summary) = match Checked::resolve(&args.file)? {
        Checked::Scenario(scenario) => ("scenario", summary::scenario(&scenario)),
        Checked::Config(config) => ("configuration", summary::config(&config)),
    };
    crate::show(&format!("{}: a sound {kind}\n{summary}", args.file));
    Ok(())
}
