//! The one place that lists every key, with its range. A new key is one line here, one field in
//! its struct and one row in `docs/CONFIGURATION.md`.

use super::robust::leaves_room;
use super::rules::{arena_holds_the_scenario, contradictions};
use super::{
    AdminConfig, ChannelConfig, Config, ControllerConfig, DisturbanceConfig, GuidanceParams, JournalConfig,
    RealTimeConfig, SourceConfig, TelemetryConfig, TimingConfig, Weights, is_fleet_name,
};
use crate::document::{Asked, ConfigError, Document, ErrorKind, Found, Place, Problem, Section};
use crate::model::Disturbance;
use crate::scenario::{Scenario, has_file_ending};
use std::ops::Bound::{Excluded, Included};
use std::path::Path;

const SCHEMA: u64 = 1;
const SECOND_US: u64 = 1_000_000;
/// Beyond any machine; keeps a typing slip from starting a million threads.
const CPUS_MAX: u64 = 4095;

/// Reads and checks a whole document; `file` is where it came from, if it is a file.
pub(super) fn read(doc: Document, file: Option<&Path>) -> Result<Config, ConfigError> {
    let config = build(&doc, file, None)?;
    doc.finish(config)
}

/// The same around a scenario that is there already, whatever the document names.
pub(super) fn read_around(doc: Document, file: &Path, scenario: Scenario) -> Result<Config, ConfigError> {
    let config = build(&doc, Some(file), Some(scenario))?;
    doc.finish(config)
}

/// `None` when a problem was noted in the document.
fn build(
    doc: &Document,
    file: Option<&Path>,
    given: Option<Scenario>,
) -> Result<Option<Config>, ConfigError> {
    let mut root = doc.root();
    if file.is_some() {
        root.check_schema(SCHEMA);
    } else {
        // Arguments alone carry no format version.
        root.natural("schema");
    }
    let fleet = fleet(&mut root);
    let scenario = root.text("scenario");
    let scenario = if file.is_some() {
        root.require("scenario", scenario, "a built-in name or a path, for instance scenario = \"swap8\"")
    } else {
        scenario
    };
    let timing = timing(root.section("timing"), TimingConfig::default());
    let realtime = realtime(root.section("realtime"), RealTimeConfig::default());
    let controller = controller(root.section("controller"), ControllerConfig::default());
    let guidance = GuidanceParams::default().read(root.section("guidance"));
    let (bounds, written) = robust(root.section("robust"), Disturbance::NONE);
    let disturbance = disturbance(root.section("disturbance"), DisturbanceConfig::default());
    let source = source(root.section("source"), SourceConfig::default());
    let telemetry = telemetry(root.section("telemetry"), TelemetryConfig::default());
    let admin = admin(root.section("admin"), AdminConfig::default());
    let journal = journal(root.section("journal"), file, JournalConfig::default());
    let channel = channel(root.section("channel"), ChannelConfig::default());
    root.finish();

    contradictions(doc, &timing, &realtime, &controller, &source);
    // A scenario has problems of its own, in its own file: they are reported alone.
    let resolved = match &scenario {
        _ if !doc.is_sound() => None,
        _ if given.is_some() => given,
        Some(found) => resolve(doc, found, file)?,
        None => Some(Scenario::builtin("swap8")?),
    };
    let config = resolved.map(|resolved| Config {
        fleet: fleet.unwrap_or_else(|| "default".to_owned()),
        scenario: resolved,
        timing: timing.value,
        realtime: realtime.value,
        controller: controller.value,
        guidance,
        robust: bounds,
        disturbance,
        source: source.value,
        telemetry,
        admin,
        journal,
        channel,
    });
    if let Some(config) = &config {
        let place = scenario.as_ref().map(|s| &s.place);
        arena_holds_the_scenario(doc, config, source.arena.as_ref(), place);
        leaves_room(doc, config, &written, timing.period.as_ref(), place);
    }
    Ok(config)
}

/// Every setting of `config` with its value.
pub(super) fn settings(config: &Config) -> Result<Vec<Asked>, ConfigError> {
    let doc = Document::parse("", "configuration")?;
    let mut root = doc.root();
    timing(root.section("timing"), config.timing);
    realtime(root.section("realtime"), config.realtime.clone());
    controller(root.section("controller"), config.controller);
    config.guidance.read(root.section("guidance"));
    robust(root.section("robust"), config.robust);
    disturbance(root.section("disturbance"), config.disturbance);
    source(root.section("source"), config.source);
    telemetry(root.section("telemetry"), config.telemetry);
    admin(root.section("admin"), config.admin);
    journal(root.section("journal"), None, config.journal.clone());
    channel(root.section("channel"), config.channel.clone());
    Ok(doc.settings())
}

fn fleet(root: &mut Section<'_>) -> Option<String> {
    let name = root.text("fleet")?;
    if !is_fleet_name(&name.value) {
        let message = format!("`{}` cannot be part of a channel's name", name.value);
        root.refuse("fleet", &name.place, &message, "use 1 to 64 of the characters a-z, A-Z, 0-9, - and _");
        return None;
    }
    Some(name.value)
}

pub(super) struct Timing {
    pub(super) value: TimingConfig,
    pub(super) period: Option<Place>,
    pub(super) margin: Option<Place>,
}

fn timing(mut s: Section<'_>, mut t: TimingConfig) -> Timing {
    let period = s.set_micros("period_us", &mut t.period_ns, 200..=SECOND_US);
    let margin = s.set_micros_or(
        "deadline_margin_us",
        &mut t.deadline_margin_ns,
        0..=SECOND_US,
        "a quarter of the period, at most 2000",
    );
    s.set_choice("publish", &mut t.publish);
    s.set_integer_or(
        "workers",
        &mut t.workers,
        1..=CPUS_MAX,
        "as many as the robots and the usable cores allow",
    );
    s.set_integer_or("ticks", &mut t.ticks, 1..=u64::from(u32::MAX), "until a signal");
    s.finish();
    Timing { value: t, period, margin }
}

pub(super) struct RealTime {
    pub(super) value: RealTimeConfig,
    pub(super) policy: Option<Place>,
    pub(super) wakeup: Option<Place>,
}

fn realtime(mut s: Section<'_>, mut r: RealTimeConfig) -> RealTime {
    let policy = s.set_choice("policy", &mut r.policy);
    s.set_integer("priority", &mut r.priority, 1..=99);
    s.set_integer_or("loop_cpu", &mut r.loop_cpu, 0..=CPUS_MAX, "the first usable one");
    s.set_distinct(
        "worker_cpus",
        &mut r.worker_cpus,
        0..=CPUS_MAX,
        "the usable ones from the last backwards",
    );
    s.set_flag("lock_memory", &mut r.lock_memory);
    s.set_flag("stay_awake", &mut r.stay_awake);
    let wakeup = s.set_choice("wakeup", &mut r.wakeup);
    s.finish();
    RealTime { value: r, policy, wakeup }
}

fn admin(mut s: Section<'_>, mut a: AdminConfig) -> AdminConfig {
    s.set_integer("capacity", &mut a.capacity, 0..=Scenario::MAX_ROBOTS as u64);
    s.set_integer("max_clients", &mut a.max_clients, 1..=256);
    s.set_integer("changes_per_period", &mut a.changes_per_period, 1..=64);
    s.finish();
    a
}

/// A path in a file is relative to that file.
fn journal(mut s: Section<'_>, file: Option<&Path>, mut j: JournalConfig) -> JournalConfig {
    if let Some(path) = s.text("path") {
        let folder = file.and_then(Path::parent).filter(|_| !path.place.is_override());
        j.path = Some(folder.map_or_else(|| path.value.clone().into(), |folder| folder.join(&path.value)));
    }
    s.set_integer("restarts", &mut j.restarts, 0..=1000);
    s.set_seconds("restarts_within_s", &mut j.restarts_within_ns, 1..=86_400);
    s.finish();
    j
}

fn channel(mut s: Section<'_>, mut c: ChannelConfig) -> ChannelConfig {
    if let Some(prefix) = s.text("prefix") {
        c.prefix = prefix.value;
    }
    if let Some(root) = s.text("root") {
        c.root = root.value.into();
    }
    s.set_integer("max_readers", &mut c.max_readers, 4..=1024);
    s.set_integer("max_observers", &mut c.max_observers, 1..=1024);
    s.set_integer_or(
        "depth",
        &mut c.depth,
        1..=4096,
        "as many as fit into 32 MiB, from 8 to 64 (from 2 for samples over 1 MiB)",
    );
    s.finish();
    c
}

pub(super) struct Controller {
    pub(super) value: ControllerConfig,
    pub(super) gamma: Option<Place>,
    pub(super) comfort_gamma: Option<Place>,
}

fn controller(mut s: Section<'_>, mut c: ControllerConfig) -> Controller {
    let share = (Excluded(0.0), Included(1.0));
    s.set_choice("profile", &mut c.profile);
    s.set_choice("solver", &mut c.solver);
    s.set_choice("barrier", &mut c.barrier);
    s.set_number("c3", &mut c.c3, (Excluded(0.0), Included(100.0)));
    s.set_number("alpha", &mut c.alpha, (Excluded(0.0), Excluded(1.0)));
    s.set_number("alignment", &mut c.alignment, share);
    let gamma = s.set_number("gamma", &mut c.gamma, share);
    let comfort_gamma = s.set_number("comfort_gamma", &mut c.comfort_gamma, share);
    if comfort_gamma.is_none() {
        // The default softens along with `gamma`.
        c.comfort_gamma = c.comfort_gamma.min(c.gamma);
    }
    s.set_flag("guidance", &mut c.guidance);
    s.set_integer("max_neighbours", &mut c.max_neighbours, 1..=1024);
    c.weights = weights(s.section("weights"), c.weights);
    s.finish();
    Controller { value: c, gamma, comfort_gamma }
}

fn weights(mut s: Section<'_>, mut w: Weights) -> Weights {
    // Twelve orders of magnitude around 1: beyond it the solvers run out of digits.
    let range = 1e-6..=1e6;
    s.set_number("v", &mut w.v, range.clone());
    s.set_number("omega", &mut w.omega, range.clone());
    s.set_number("position", &mut w.position, range.clone());
    s.set_number("heading", &mut w.heading, range.clone());
    s.set_number("comfort", &mut w.comfort, range);
    s.finish();
    w
}

pub(super) struct Source {
    pub(super) value: SourceConfig,
    pub(super) max_age: Option<Place>,
    pub(super) arena: Option<Place>,
}

fn source(mut s: Section<'_>, mut v: SourceConfig) -> Source {
    s.set_choice("kind", &mut v.kind);
    s.set_choice("plant", &mut v.plant);
    let max_age = s.set_micros_or("max_age_us", &mut v.max_age_ns, 1..=60 * SECOND_US, "two periods");
    let arena = s.set_number("arena_m", &mut v.arena_m, 1.0..=1e5);
    s.set_number("jump_margin_m", &mut v.jump_margin_m, 0.0..=1e3);
    s.set_number("turn_margin_rad", &mut v.turn_margin_rad, 0.0..=4.0);
    s.finish();
    Source { value: v, max_age, arena }
}

/// A time in s as the settings keep it, ns.
fn nanoseconds(s: f64) -> u64 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a checked, short time
    let ns = (s * 1e9).round() as u64;
    ns
}

/// Where the values of a disturbance stand.
pub(super) type Written = Vec<(&'static str, Place)>;

fn robust(mut s: Section<'_>, d: Disturbance) -> (Disturbance, Written) {
    let read = amplitudes(&mut s, d);
    s.finish();
    read
}

fn disturbance(mut s: Section<'_>, mut d: DisturbanceConfig) -> DisturbanceConfig {
    s.set_choice("pattern", &mut d.pattern);
    s.set_integer("seed", &mut d.seed, 0..=i64::MAX.unsigned_abs());
    d.amplitude = amplitudes(&mut s, d.amplitude).0;
    s.finish();
    d
}

fn amplitudes(s: &mut Section<'_>, mut d: Disturbance) -> (Disturbance, Written) {
    let mut written = Vec::new();
    let [mut lag_ns, mut delay_ns] = [d.lag_s, d.delay_s].map(nanoseconds);
    for (key, target, most) in [
        ("position_m", &mut d.position_m, 10.0),
        ("heading_rad", &mut d.heading_rad, 1.0),
        ("slip", &mut d.slip, 1.0),
        ("turn_rate_radps", &mut d.turn_rate_radps, 10.0),
    ] {
        written.extend(s.set_number(key, target, 0.0..=most).map(|place| (key, place)));
    }
    for (key, target) in [("lag_us", &mut lag_ns), ("delay_us", &mut delay_ns)] {
        written.extend(s.set_micros(key, target, 0..=SECOND_US).map(|place| (key, place)));
    }
    (d.lag_s, d.delay_s) = (lag_ns as f64 * 1e-9, delay_ns as f64 * 1e-9);
    (d, written)
}

fn telemetry(mut s: Section<'_>, mut t: TelemetryConfig) -> TelemetryConfig {
    s.set_integer("queue_periods", &mut t.queue_periods, 1..=65_536);
    s.set_integer("audit_every", &mut t.audit_every, 0..=1_000_000);
    s.finish();
    t
}

/// Reads the scenario that `found` names. A path in a file is relative to that file.
fn resolve(
    doc: &Document,
    found: &Found<String>,
    file: Option<&Path>,
) -> Result<Option<Scenario>, ConfigError> {
    let folder = file.and_then(Path::parent).filter(|_| !found.place.is_override());
    let beside = folder.map(|folder| folder.join(&found.value)).filter(|path| path.is_file());
    match (beside, folder) {
        (Some(path), _) => Scenario::load(&path).map(Some),
        (None, Some(folder)) if has_file_ending(&found.value) => {
            let message = format!("there is no file {}", folder.join(&found.value).display());
            let help = "give a path relative to this file, or the name of a built-in scenario";
            doc.report(
                Problem::new(ErrorKind::Unreadable, "scenario", message)
                    .at(&found.place, "not found")
                    .advise(help),
            );
            Ok(None)
        }
        _ => match Scenario::resolve(&found.value) {
            Err(error) if error.first().line().is_none() => {
                let first = error.first().clone();
                doc.report(first.under("scenario").at(&found.place, "this scenario"));
                Ok(None)
            }
            other => other.map(Some),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_stands_in_the_documentation_with_its_range_and_default() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/CONFIGURATION.md");
        let text = std::fs::read_to_string(path).unwrap();
        let doc = Document::parse("", "none").unwrap();
        build(&doc, None, None).unwrap();
        let settings = doc.settings();
        assert!(settings.len() > 20);
        for setting in settings {
            let row = text.lines().find(|line| line.starts_with(&format!("| `{}` |", setting.key)));
            let row = row.unwrap_or_else(|| panic!("no row for {setting:?}"));
            let cells: Vec<&str> = row.split(" | ").collect();
            assert_eq!(cells[2..4], [setting.default.as_str(), setting.range.as_str()], "{row}");
        }
        for key in ["schema", "fleet", "scenario"] {
            assert!(text.contains(&format!("| `{key}` |")), "no row for {key}");
        }
    }
}
