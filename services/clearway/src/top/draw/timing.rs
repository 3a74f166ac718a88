use clearway::figures::{LatencyHistogram, LatencyNs};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use super::{Look, Page, fitting};
use crate::top::model::Model;
use crate::top::text::{NOTHING, count, number, time};
use crate::top::times::{Measure, RECENT_S, distribution, known};
use crate::top::view::View;

/// Lines of [`compact`].
pub(super) const COMPACT_LINES: u16 = 4;
/// Columns of a row without its distribution.
const ROW: usize = 16 + 4 * 8 + 7;
/// The axis of all distributions, ns.
const AXIS_NS: (f64, f64) = (1e2, 1e8);
/// Measures of the overview.
const COMPACT: usize = 3;

fn cells(summary: &LatencyNs, look: Look) -> [String; 5] {
    let one = |ns: u64| if known(summary) { time(ns, look.ascii) } else { NOTHING.to_owned() };
    [one(summary.p50), one(summary.p99), one(summary.p999), one(summary.max), count(summary.count)]
}

fn row(name: &str, [p50, p99, p999, max, n]: [String; 5]) -> String {
    format!("{name:<16}{p50:>8}{p99:>8}{p999:>8}{max:>8}{n:>7}")
}

fn heads() -> [String; 5] {
    ["p50", "p99", "p99.9", "max", "count"].map(str::to_owned)
}

/// Height of a bar from 0 to `full`: by the logarithm, so that one late period among a million shows.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to full")]
fn height(n: u64, most: u64, full: usize) -> usize {
    if n == 0 || full == 0 {
        return 0;
    }
    let share = (n as f64).ln_1p() / (most.max(1) as f64).ln_1p();
    ((share * full as f64).round() as usize).clamp(1, full)
}

fn sparkline(histogram: &LatencyHistogram, width: usize, look: Look) -> String {
    let bins = distribution(histogram, width, AXIS_NS.0, AXIS_NS.1);
    let most = bins.iter().copied().max().unwrap_or(0);
    let bars = look.bars();
    bins.iter().map(|n| bars[height(*n, most, bars.len() - 1)]).collect()
}

/// The ends of the distributions' axis.
fn axis(width: usize, look: Look) -> String {
    let (low, high) = (time(100, look.ascii), time(100_000_000, look.ascii));
    let gap = width.saturating_sub(low.chars().count() + high.chars().count());
    if gap == 0 { String::new() } else { format!("{low}{}{high}", " ".repeat(gap)) }
}

/// The three times that matter most, of the last seconds.
pub(super) fn compact(frame: &mut Frame, area: Rect, model: &Model, look: Look, now_ns: u64) {
    let width = usize::from(area.width);
    let chart = width.saturating_sub(ROW + 2);
    let chart = if chart < 16 { 0 } else { chart };
    let shortened = |text: String| fit_row(&text, width);
    let head = shortened(row(&format!("last {RECENT_S} s"), heads()));
    let head = Line::from(vec![
        Span::styled(head, look.title()),
        Span::styled(if chart > 0 { format!("  {}", axis(chart, look)) } else { String::new() }, Look::ASIDE),
    ]);
    let rows = model.run.iter().flat_map(|run| run.times.each().take(COMPACT)).map(|(what, track)| {
        let recent = track.recent(now_ns);
        let text = shortened(row(what.title(), cells(&recent.summary(), look)));
        let bars = if chart > 0 { format!("  {}", sparkline(&recent, chart, look)) } else { String::new() };
        Line::from(vec![Span::raw(text), Span::styled(bars, look.mark())])
    });
    super::lines(frame, area, std::iter::once(head).chain(rows));
}

/// Leaves whole columns out where a row is too long.
fn fit_row(text: &str, width: usize) -> String {
    let ends = [ROW, ROW - 7, ROW - 15, ROW - 23, ROW - 31, 16];
    let end = ends.into_iter().find(|end| *end <= width).unwrap_or(0);
    text.chars().take(end).collect()
}

/// Counters, clearance and who is attached, in the lines that they need.
pub(super) fn facts(model: &Model, look: Look, width: u16) -> Vec<Line<'static>> {
    let counted = |what: &str, n: u64, style: Style| {
        Span::styled(format!("{what} {}", count(n)), if n > 0 { style } else { Style::new() })
    };
    let mut facts = Vec::new();
    if let Some(status) = &model.status {
        let f = &status.figures;
        facts.push(fitting(
            width,
            [
                Span::styled("since start", look.title()),
                counted("missed", f.deadline_misses, look.bad()),
                counted("skipped", f.skipped_periods, look.bad()),
                counted("fallbacks", f.fallback_commands, look.bad()),
                counted("rejected", f.rejected_inputs, look.warning()),
                counted("lost", f.lost_records, look.warning()),
            ],
        ));
    }
    if let Some(run) = &model.run {
        let c = &run.counters;
        facts.push(fitting(
            width,
            [
                Span::styled("watched", look.title()),
                Span::raw(format!("{} periods", count(run.telemetry.samples))),
                counted("late", c.late, look.bad()),
                counted("skipped", c.skipped, look.bad()),
                counted("fallbacks", c.fallbacks, look.bad()),
                counted("not read", c.dropped + run.overwritten(), look.warning()),
                counted("lost", c.lost_records, look.warning()),
            ],
        ));
        let clearance = model.clearance_m();
        let style = if clearance.is_some_and(|m| m < 0.0) { look.bad() } else { Style::new() };
        let clearance = clearance.map_or(NOTHING.to_owned(), |m| format!("{} m", number(m, 7)));
        let mut pieces = vec![
            Span::styled("min clearance", look.title()),
            Span::styled(clearance, style),
            Span::styled("attached", look.title()),
        ];
        pieces.extend(super::attached::short(model).into_iter().map(Span::raw));
        facts.push(fitting(width, pieces));
    }
    facts
}

/// Every time, since the monitor attached and of the last seconds, and one of them drawn large.
pub(super) fn draw(frame: &mut Frame, area: Rect, model: &Model, view: &View, look: Look, now_ns: u64) {
    let Some(run) = &model.run else { return };
    let mut page = Page { left: area };
    let chosen = Measure::ALL[view.measure % Measure::ALL.len()];
    let width = usize::from(area.width);
    let recent = format!("last {RECENT_S} s");
    for (title, whole) in [("since attached", true), (recent.as_str(), false)] {
        let head = Line::styled(fit_row(&row(title, heads()), width), look.title());
        let rows = run.times.each().map(|(what, track)| {
            let summary = if whole { track.all().summary() } else { track.recent(now_ns).summary() };
            let style = if what == chosen { Look::CHOSEN } else { Style::new() };
            Line::styled(fit_row(&row(what.title(), cells(&summary, look)), width), style)
        });
        let table: Vec<Line> = std::iter::once(head).chain(rows).collect();
        let needed = u16::try_from(table.len()).unwrap_or(0);
        let at = page.take(needed);
        super::lines(frame, at, table);
    }
    for (what, track) in run.times.each().filter(|(what, _)| *what == chosen) {
        chart(frame, page.left, what, track.all(), look);
    }
}

/// A histogram as high as there is room.
fn chart(frame: &mut Frame, area: Rect, what: Measure, histogram: &LatencyHistogram, look: Look) {
    if area.height < 3 || area.width < 20 {
        return;
    }
    let (width, rows) = (usize::from(area.width), usize::from(area.height - 2));
    let bins = distribution(histogram, width, AXIS_NS.0, AXIS_NS.1);
    let most = bins.iter().copied().max().unwrap_or(0);
    let bars = look.bars();
    let steps = bars.len() - 1;
    let title = fitting(
        area.width,
        [
            Span::styled(what.title(), look.title()),
            Span::styled(format!("since attached, most {} in a bar, log scales", count(most)), Look::ASIDE),
        ],
    );
    let body = (0..rows).rev().map(|row| {
        let line: String = bins
            .iter()
            .map(|n| bars[height(*n, most, rows * steps).saturating_sub(row * steps).min(steps)])
            .collect();
        Line::styled(line, look.mark())
    });
    let axis = Line::styled(axis(width, look), Look::ASIDE);
    super::lines(frame, area, std::iter::once(title).chain(body).chain([axis]));
}
