//! The histograms as complementary distributions, both axes logarithmic.

use clearway::figures::LatencyHistogram;

use super::report::Measured;
use crate::plot::{Axis, Figure, Panel, Style};

/// One panel for each figure, one line for each load.
pub(super) fn svg(measured: &[Measured], period_us: f64, cyclictest: Option<&LatencyHistogram>) -> String {
    let mut release = panel("release lateness");
    let mut channel = panel("one way, state of 8 robots, polled");
    let mut command = panel("state → command in another process");
    let mut reader = panel("command → reader in another process");
    for (index, run) in measured.iter().enumerate() {
        let (name, style) = (run.load, Style::nth(index));
        let h = &run.distributions;
        release.line(name, distribution(&h.release_lateness), style);
        channel.line(name, distribution(&h.channel), style);
        command.line(name, distribution(&h.state_to_command), style);
        reader.line(name, distribution(&h.command_to_reader), style);
    }
    if let Some(theirs) = cyclictest {
        release.line("cyclictest", distribution(theirs), Style::nth(measured.len()));
    }
    let title = format!("Latency at a period of {period_us} µs: share of samples above each time");
    Figure::new(&title)
        .columns(2)
        .panel_height(280.0)
        .with(release)
        .with(channel)
        .with(command)
        .with(reader)
        .svg()
}

fn panel(title: &str) -> Panel {
    Panel::new(Axis::log("time", "µs"), Axis::log("share above", "").to(1.0)).titled(title)
}

/// For each step the share of samples that reach it, from 1 down to the largest alone. The axis has
/// microseconds.
fn distribution(histogram: &LatencyHistogram) -> Vec<(f64, f64)> {
    let total: u64 = histogram.steps().map(|(_, count)| count).sum();
    let mut left = total;
    let all = histogram.steps().map(|(ns, count)| {
        let share = left as f64 / total as f64;
        left -= count;
        (ns as f64 / 1e3, share)
    });
    thinned(all.collect())
}

/// Without the points that nobody could tell from the one before; the last one stays.
fn thinned(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let (last, mut kept) = (points.last().copied(), Vec::<(f64, f64)>::new());
    for point in points {
        let apart = |(x, share): &(f64, f64)| point.0 > x * 1.02 || point.1 < share * 0.97;
        if kept.last().is_none_or(apart) || Some(point) == last {
            kept.push(point);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distribution_falls_from_1_to_the_largest() {
        let mut histogram = LatencyHistogram::new().unwrap();
        for ns in [1000, 1000, 2000, 100_000] {
            histogram.record(ns);
        }
        let points = distribution(&histogram);
        assert_eq!(points.iter().map(|(_, share)| *share).collect::<Vec<_>>(), [1.0, 0.5, 0.25]);
        assert_eq!(thinned(vec![(1.0, 1.0), (1.001, 0.999), (1.002, 0.998)]), [(1.0, 1.0), (1.002, 0.998)]);
        assert!((points[0].0 - 1.0).abs() < 0.01 && (points[2].0 - 100.0).abs() < 0.2);
    }
}
