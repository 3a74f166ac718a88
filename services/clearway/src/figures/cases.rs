//! What is run: for every case each of its scenarios under every control law.

use super::{Args, LAWS};
use clearway::config::{Config, Profile};
use clearway::evaluation::{self, Trace};
use clearway::scenario::Scenario;
use miette::{IntoDiagnostic, Result, WrapErr, miette};

/// Scenarios that are shown together, under every law.
#[derive(Debug)]
pub(super) struct Case {
    /// As panels are titled.
    pub(super) title: String,
    /// As files are called.
    pub(super) slug: String,
    /// The configuration of the first scenario.
    pub(super) config: Config,
    /// For each of [`LAWS`] the runs, one a scenario.
    runs: [Vec<Trace>; 3],
}

impl Case {
    /// The runs under a law, one a scenario; never empty.
    pub(super) fn under(&self, profile: Profile) -> &[Trace] {
        let law = LAWS.iter().position(|law| *law == profile).unwrap_or(0);
        &self.runs[law]
    }

    /// Until when to draw, s: all that happens under the two laws that keep robots apart.
    pub(super) fn end_s(&self) -> f64 {
        let runs = [Profile::Certified, Profile::Exponential].into_iter().flat_map(|law| self.under(law));
        runs.map(|run| run.time_s(run.periods.len())).fold(0.0, f64::max)
    }
}

/// A case before it is run: title, name of its files, scenarios.
fn planned(args: &Args) -> Vec<(String, String, Vec<String>)> {
    let one = |title: &str, name: &str| (title.to_owned(), name.to_owned(), vec![name.to_owned()]);
    if !args.scenario.is_empty() {
        return args.scenario.iter().map(|name| one(name, name)).collect();
    }
    let seeds = (0..args.seeds).map(|seed| format!("swap8-heading-{seed}")).collect();
    vec![
        one("headings toward the goal", "swap8"),
        one("all headings 0", "swap8-zero"),
        (format!("random headings, {} seeds", args.seeds), "swap8-heading-0".to_owned(), seeds),
    ]
}

/// Runs every case.
pub(super) fn run(args: &Args) -> Result<Vec<Case>> {
    if args.set.iter().any(|set| set.trim_start().starts_with("controller.profile")) {
        return Err(miette!(help = "every figure shows all of them", "the control law cannot be set here"));
    }
    if args.scenario.len() > 3 {
        return Err(miette!(help = "draw the others into another folder", "more than three scenarios"));
    }
    let mut cases = Vec::new();
    let mut jobs: Vec<(usize, usize, Config)> = Vec::new();
    for (case, (title, name, members)) in planned(args).into_iter().enumerate() {
        for (k, member) in members.iter().enumerate() {
            let scenario = Scenario::resolve(member)?;
            let mut config = Config { scenario, ..Config::with_overrides(None, &args.set)? };
            config.source.plant = args.plant.unwrap_or(config.source.plant);
            if k == 0 {
                // A file is called by what it holds, and so is its title.
                let file = title == name;
                let title = if file { config.scenario.name.clone() } else { title.clone() };
                let slug = if file { slug(&config.scenario.name) } else { slug(&name) };
                cases.push(Case { title, slug, config: config.clone(), runs: [const { Vec::new() }; 3] });
            }
            for (law, profile) in LAWS.into_iter().enumerate() {
                let mut config = config.clone();
                config.controller.profile = profile;
                jobs.push((case, law, config));
            }
        }
    }
    let slugs: std::collections::BTreeSet<&str> = cases.iter().map(|case| case.slug.as_str()).collect();
    if slugs.len() < cases.len() {
        let help = "give them different names";
        return Err(miette!(help = help, "two scenarios have the same name"));
    }
    let one = |(_, _, config): &(usize, usize, Config)| {
        let trace = evaluation::trace(config, args.timing).into_diagnostic();
        Ok(trace.wrap_err_with(|| format!("{} could not run", config.scenario.name))?.1)
    };
    let mut traces: Vec<Option<Trace>> = jobs.iter().map(|_| None).collect();
    crate::batch::run(&jobs, args.jobs, one, |k, trace| {
        traces[k] = Some(trace);
        Ok(())
    })?;
    for ((case, law, _), trace) in jobs.iter().zip(traces) {
        cases[*case].runs[*law].extend(trace);
    }
    Ok(cases)
}

/// A name that can be a file's.
fn slug(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '-' };
    name.chars().map(plain).collect()
}
