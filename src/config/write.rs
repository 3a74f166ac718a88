use super::{Config, read};
use crate::document::quoted;
use std::fmt::Write;

/// The configuration as TOML that reads back to the same settings. A scenario from a file goes by its
/// name, which only the daemon that read it can resolve.
pub(super) fn to_toml(config: &Config) -> String {
    let mut out = format!(
        "schema = 1\nfleet = {}\nscenario = {}\n",
        quoted(&config.fleet),
        quoted(&config.scenario.name)
    );
    let mut section = String::new();
    // Only a text that is wrong could be refused, and there is none.
    for setting in read::settings(config).unwrap_or_default() {
        let Some((path, key)) = setting.key.rsplit_once('.') else { continue };
        if path != section {
            path.clone_into(&mut section);
            let _ = writeln!(out, "\n[{section}]");
            if section == "journal" {
                let path = config.journal.path.as_ref().map(|path| quoted(&path.to_string_lossy()));
                let _ = match path {
                    Some(path) => writeln!(out, "path = {path}"),
                    None => writeln!(out, "# path: nothing is kept"),
                };
            }
            if section == "channel" {
                let root = config.channel.root.to_string_lossy();
                let _ =
                    writeln!(out, "prefix = {}\nroot = {}", quoted(&config.channel.prefix), quoted(&root));
            }
        }
        let _ = match setting.value {
            Some(value) => writeln!(out, "{key} = {value}"),
            None => writeln!(out, "# {key}: {}", setting.default),
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{BarrierForm, RealTimePolicy, SourceKind};
    use crate::scenario::Scenario;

    #[test]
    fn what_is_written_reads_back_around_a_scenario_from_a_file() {
        let mut config = Config::new(Scenario::builtin("random-20-3").unwrap());
        config.scenario.name = "mine".to_owned();
        config.timing.period_ns = 20_000_000;
        let scenario = Scenario::parse(&config.scenario.to_toml(), "scenario.toml").unwrap();
        assert_eq!(Config::parse_around(&to_toml(&config), "written.toml", scenario).unwrap(), config);
    }

    #[test]
    fn what_is_written_reads_back() {
        let mut config = Config::new(Scenario::builtin("circle-12").unwrap());
        assert_eq!(Config::parse(&to_toml(&config), "written.toml").unwrap(), config);
        config.fleet = "night-shift".to_owned();
        config.timing.period_ns = 12_345_000;
        config.timing.workers = Some(3);
        config.timing.deadline_margin_ns = Some(7_000);
        config.realtime.policy = RealTimePolicy::Require;
        config.realtime.worker_cpus = vec![3, 1];
        config.controller.barrier = BarrierForm::Linear;
        config.controller.c3 = 1e-7;
        config.controller.weights.comfort = 0.1 + 0.2;
        config.guidance.align_cos = -1.0 / 3.0;
        config.source.kind = SourceKind::Observation;
        config.source.max_age_ns = Some(50_000_000);
        config.robust.position_m = 0.01;
        config.robust.lag_s = 0.0123;
        config.disturbance.amplitude.delay_s = 0.01;
        config.disturbance.seed = 7;
        config.admin.capacity = 40;
        config.journal.path = Some("/var/lib/a \"b\"/x.journal".into());
        config.journal.restarts_within_ns = 7_000_000_000;
        config.channel.prefix = "a \"quoted\" one".to_owned();
        config.channel.depth = Some(9);
        assert_eq!(Config::parse(&to_toml(&config), "written.toml").unwrap(), config);
    }
}
