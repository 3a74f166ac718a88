use clearway::document::ConfigError;
use clearway::scenario::Scenario;

/// List the built-in scenarios, or print one as TOML.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway scenario                       list the families
  clearway scenario circle-10 > mine.toml a file to edit and run

Exit codes: 0 done, 2 there is no such scenario.")]
pub(crate) struct Args {
    /// A built-in name, such as swap8, or a file.
    name: Option<String>,
}

pub(crate) fn run(args: &Args) -> Result<(), ConfigError> {
    let text = if let Some(name) = &args.name {
        Scenario::resolve(name)?.to_toml()
    } else {
        let line = |(pattern, about)| format!("{pattern:<20}  {about}\n");
        Scenario::builtins().map(line).collect::<Vec<_>>().concat()
    };
    crate::show(&text);
    Ok(())
}
