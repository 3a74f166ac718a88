//! rt-tests' cyclictest beside the releases: the same CPU, priority and period, in turns.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use clearway::figures::{LatencyHistogram, LatencyNs};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::{Deserialize, Serialize};

use super::release;
use super::world::{Interrupt, World};

/// Longest time that cyclictest resolves in nanoseconds; longer ones are only counted.
const RESOLVED_NS: u64 = 1_000_000;
/// A block lasts about this long, ns.
const BLOCK_NS: u64 = 1_000_000_000;
/// Resamples for the interval of a ratio.
const RESAMPLES: usize = 400;

/// Ours over cyclictest's.
#[derive(Debug, Serialize)]
pub(super) struct Comparison {
    version: String,
    command: String,
    /// Pairs of blocks that took turns.
    pub(super) blocks: usize,
    samples_per_block: u64,
    pub(super) release_lateness_ns: LatencyNs,
    pub(super) cyclictest_ns: LatencyNs,
    /// Of cyclictest's, those beyond what it resolves; they count as 1 ms.
    overflows: u64,
    pub(super) ratio: Ratios,
    /// Where 90 % of the ratios fall when the pairs of blocks are drawn again, low and high.
    pub(super) ratio_p999_interval: [f64; 2],
    /// Upper end of each step, ns, and its count, so that runs can be put together.
    histograms: BTreeMap<&'static str, Vec<(u64, u64)>>,
    #[serde(skip)]
    pub(super) theirs: LatencyHistogram,
}

/// Quantiles of ours over cyclictest's.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Ratios {
    pub(super) p50: f64,
    pub(super) p99: f64,
    pub(super) p999: f64,
    pub(super) max: f64,
}

/// What is measured, and for how long.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setting {
    pub(super) period_ns: u64,
    pub(super) samples: u64,
    pub(super) priority: u8,
    pub(super) cpu: usize,
}

/// Whether it is there; otherwise how to get it.
pub(super) fn version() -> Result<String> {
    let help = Command::new("cyclictest").arg("--help").stdin(Stdio::null()).output().map_err(|e| {
        miette!(
            help = "install rt-tests: `apt-get install rt-tests` (Debian, Ubuntu), `dnf install \
                    realtime-tests` (Fedora), `pacman -S rt-tests` (Arch)",
            "cyclictest cannot be run: {e}"
        )
    })?;
    let text = [help.stdout, help.stderr].concat();
    let text = String::from_utf8_lossy(&text);
    Ok(text.lines().find(|line| line.starts_with("cyclictest V")).unwrap_or("cyclictest").trim().to_owned())
}

/// Measures both in turns; `each` hears how far it is.
pub(super) fn compare(
    world: &World,
    setting: Setting,
    interrupt: &Interrupt,
    mut each: impl FnMut(usize, usize),
) -> Result<Comparison> {
    let version = version()?;
    let per_block = (BLOCK_NS / setting.period_ns).clamp(20, setting.samples.max(20));
    let blocks = usize::try_from(setting.samples.div_ceil(per_block)).into_diagnostic()?.max(2);
    let (mut ours, mut theirs, mut overflows) = (Vec::new(), Vec::new(), 0);
    for block in 0..blocks {
        each(block, blocks);
        // Who is first changes, so that neither always follows the other.
        for turn in [block % 2, (block + 1) % 2] {
            interrupt.check()?;
            if turn == 0 {
                let Setting { period_ns, priority, cpu, .. } = setting;
                ours.push(release::measure(period_ns, per_block, priority, cpu, interrupt)?.lateness);
            } else {
                let (histogram, beyond) = block_of_theirs(world, setting, per_block, interrupt)?;
                theirs.push(histogram);
                overflows += beyond;
            }
        }
    }
    let pick: Vec<usize> = (0..blocks).collect();
    let (all_ours, all_theirs) = (merged(&ours, &pick)?, merged(&theirs, &pick)?);
    Ok(Comparison {
        version,
        command: arguments(setting, per_block, Path::new("FILE")).join(" "),
        blocks,
        samples_per_block: per_block,
        release_lateness_ns: all_ours.summary(),
        cyclictest_ns: all_theirs.summary(),
        overflows,
        ratio: ratios(&all_ours, &all_theirs),
        ratio_p999_interval: interval(&ours, &theirs)?,
        histograms: [("release_lateness_ns", &all_ours), ("cyclictest_ns", &all_theirs)]
            .map(|(name, histogram)| (name, histogram.steps().collect()))
            .into(),
        theirs: all_theirs,
    })
}

fn merged(blocks: &[LatencyHistogram], pick: &[usize]) -> Result<LatencyHistogram> {
    let mut all = LatencyHistogram::new().into_diagnostic()?;
    for index in pick {
        all.merge(&blocks[*index]);
    }
    Ok(all)
}

fn ratios(ours: &LatencyHistogram, theirs: &LatencyHistogram) -> Ratios {
    let (a, b) = (ours.summary(), theirs.summary());
    // Quantiles beyond what cyclictest resolves are cut off for both.
    let of = |x: u64, y: u64| x.min(RESOLVED_NS) as f64 / y.clamp(1, RESOLVED_NS) as f64;
    Ratios {
        p50: of(a.p50, b.p50),
        p99: of(a.p99, b.p99),
        p999: of(a.p999, b.p999),
        max: a.max as f64 / b.max.max(1) as f64,
    }
}

/// 5th and 95th percentile of the ratio of p99.9, over pairs of blocks drawn with replacement.
fn interval(ours: &[LatencyHistogram], theirs: &[LatencyHistogram]) -> Result<[f64; 2]> {
    let mut found = Vec::with_capacity(RESAMPLES);
    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    for _ in 0..RESAMPLES {
        let pick: Vec<usize> = (0..ours.len())
            .map(|_| {
                random =
                    random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                usize::try_from(random >> 33).unwrap_or(0) % ours.len()
            })
            .collect();
        found.push(ratios(&merged(ours, &pick)?, &merged(theirs, &pick)?).p999);
    }
    found.sort_unstable_by(f64::total_cmp);
    Ok([found[RESAMPLES / 20], found[RESAMPLES - 1 - RESAMPLES / 20]])
}

fn arguments(setting: Setting, loops: u64, json: &Path) -> Vec<String> {
    let mut arguments: Vec<String> =
        ["--quiet", "--threads=1", "--policy=fifo", "--mlockall", "--nsecs"].map(String::from).to_vec();
    arguments.extend([
        format!("--affinity={}", setting.cpu),
        format!("--priority={}", setting.priority),
        format!("--interval={}", setting.period_ns / 1000),
        format!("--loops={loops}"),
        format!("--histogram={RESOLVED_NS}"),
        // Neither of the two asks for other power states than the system has.
        "--default-system".to_owned(),
        "--histfile=/dev/null".to_owned(),
        format!("--json={}", json.display()),
    ]);
    arguments
}

/// The part of cyclictest's report that is needed.
#[derive(Debug, Deserialize)]
struct TheirReport {
    thread: BTreeMap<String, TheirThread>,
}

#[derive(Debug, Deserialize)]
struct TheirThread {
    histogram: BTreeMap<String, u64>,
    cycles: u64,
    max: u64,
}

fn block_of_theirs(
    world: &World,
    setting: Setting,
    loops: u64,
    interrupt: &Interrupt,
) -> Result<(LatencyHistogram, u64)> {
    let file = world.channel.root.join("cyclictest.json");
    let mut process = Command::new("cyclictest")
        .args(arguments(setting, loops, &file))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .into_diagnostic()?;
    let ended = wait(&mut process, interrupt);
    let _ = process.kill();
    let output = process.wait_with_output().into_diagnostic()?;
    ended?;
    if !output.status.success() {
        return Err(miette!(
            "cyclictest ended with {}: {}",
            output.status,
            String::from_utf8_lossy(&output.stderr).trim()
        ));
    }
    let text = std::fs::read_to_string(&file)
        .into_diagnostic()
        .wrap_err("cyclictest wrote no report; its version may be older than 2.0")?;
    histogram(&text)
}

fn wait(process: &mut Child, interrupt: &Interrupt) -> Result<()> {
    while process.try_wait().into_diagnostic()?.is_none() {
        interrupt.check()?;
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(())
}

/// The times of a report, and how many it did not resolve.
fn histogram(report: &str) -> Result<(LatencyHistogram, u64)> {
    let report: TheirReport =
        serde_json::from_str(report).into_diagnostic().wrap_err("cyclictest's report cannot be read")?;
    let mut histogram = LatencyHistogram::new().into_diagnostic()?;
    let mut overflows = 0;
    for thread in report.thread.values() {
        for (ns, count) in &thread.histogram {
            histogram.record_many(ns.parse().into_diagnostic()?, *count);
        }
        let beyond = thread.cycles.saturating_sub(thread.histogram.values().sum());
        if beyond > 0 {
            histogram.record(thread.max);
            histogram.record_many(RESOLVED_NS, beyond - 1);
        }
        overflows += beyond;
    }
    Ok((histogram, overflows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_read_with_what_it_did_not_resolve() {
        let report = r#"{"file_version": 1, "thread": {"0": {"histogram": {"1981": 2, "999999": 1},
            "cycles": 6, "min": 1981, "max": 2020111, "avg": 8955.0, "cpu": 1, "node": 0}}}"#;
        let (histogram, overflows) = histogram(report).unwrap();
        let summary = histogram.summary();
        assert_eq!((overflows, summary.count), (3, 6));
        assert!(summary.max >= 2_020_111 && summary.p50 >= 999_999, "{summary:?}");
        assert!(histogram_error("{}") && histogram_error("no JSON"));
    }

    fn histogram_error(text: &str) -> bool {
        histogram(text).is_err()
    }

    #[test]
    fn equal_runs_have_the_ratio_1() {
        let mut one = LatencyHistogram::new().unwrap();
        (1..=2000).for_each(|ns| one.record(ns));
        let r = ratios(&one, &one);
        assert_eq!([r.p50, r.p99, r.p999, r.max], [1.0; 4]);
        assert_eq!(interval(&[one.clone(), one.clone()], &[one.clone(), one]).unwrap(), [1.0, 1.0]);
    }
}
