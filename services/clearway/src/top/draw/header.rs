use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};

use super::{Look, fitting};
use crate::top::model::Model;
use crate::top::robot::Robot;
use crate::top::text::{count, lasted, time};
use crate::top::view::{Tab, View};

/// Whose screen this is, how the fleet is doing, and what to look at.
pub(super) fn lines(model: &Model, look: Look, now_ns: u64, width: u16) -> [Line<'static>; 3] {
    [whose(model, look, width), state(model, look, now_ns, width), alerts(model, look, now_ns, width)]
}

fn whose(model: &Model, look: Look, width: u16) -> Line<'static> {
    let mut pieces = vec![Span::styled(format!("clearway top  {}", model.fleet), look.title())];
    if let Some(run) = &model.run {
        pieces.push(Span::raw(format!("tick {}", run.tick)));
        pieces.push(Span::raw(format!("T {}", time(run.period_ns, look.ascii))));
    }
    if let Some(status) = &model.status {
        pieces.push(Span::raw(format!("up {}", lasted(status.figures.uptime_ns))));
    }
    if let Some(run) = &model.run {
        pieces.push(Span::styled(format!("epoch {}", run.epoch), Look::ASIDE));
    }
    pieces.extend(model.law.as_ref().map(|law| Span::styled(law.scenario.clone(), Look::ASIDE)));
    fitting(width, pieces)
}

fn state(model: &Model, look: Look, now_ns: u64, width: u16) -> Line<'static> {
    let word = |text: &'static str, style: Style| Span::styled(text, style.add_modifier(Modifier::BOLD));
    let mut pieces = vec![match (model.attached, model.is_live(now_ns), model.hold()) {
        (false, _, _) => word("WAITING", look.warning()),
        (true, false, _) => word("SILENT", look.bad()),
        (true, true, Some(hold)) => word(hold, look.warning()),
        (true, true, None) => word("RUNNING", look.good()),
    }];
    if let Some(run) = &model.run {
        let having = |flag: fn(&Robot) -> bool| run.robots.iter().filter(|r| flag(r)).count();
        pieces.push(Span::raw(format!("{} robots", run.robots.len())));
        pieces.push(Span::raw(format!("{} arrived", having(Robot::has_arrived))));
        let counted = |n: usize, what: &str, style: Style| {
            Span::styled(format!("{n} {what}"), if n > 0 { style } else { Style::new() })
        };
        pieces.push(counted(having(|r| r.is_stalled() && !r.has_arrived()), "stalled", look.warning()));
        pieces.push(counted(having(|r| !r.is_seen()), "unseen", look.bad()));
        pieces.push(counted(having(Robot::is_failing), "failing", look.bad()));
    }
    if let Some(law) = &model.law {
        pieces.push(Span::styled(format!("{}/{}", law.profile, law.solver), Look::ASIDE));
    }
    if let Some(status) = &model.status {
        let (workers, policy) =
            (status.figures.workers, model.law.as_ref().map_or("?", |law| law.policy.as_str()));
        pieces.push(if status.degraded.is_empty() {
            Span::styled(format!("rt {policy}"), Look::ASIDE)
        } else {
            Span::styled("DEGRADED", look.warning())
        });
        pieces.push(Span::styled(format!("{} workers", count(workers.into())), Look::ASIDE));
    }
    fitting(width, pieces)
}

fn alerts(model: &Model, look: Look, now_ns: u64, width: u16) -> Line<'static> {
    let alerts = model.alerts(now_ns);
    let grave = !model.is_live(now_ns) || model.trouble.is_some();
    let style = if grave { look.bad() } else { look.warning() };
    let shortened = |text: String| Span::styled(abridged(&text, width.into(), look), style);
    fitting(width, alerts.into_iter().map(shortened))
}

/// A text that is longer than the line ends with an ellipsis after its last whole word.
pub(super) fn abridged(text: &str, width: usize, look: Look) -> String {
    let text = text.replace('\n', " ");
    if crate::top::text::columns(&text) <= width {
        return text;
    }
    let end = look.either("…", "...");
    let room = width.saturating_sub(crate::top::text::columns(end) + 1);
    let kept: String = text.chars().take(room).collect();
    let whole = kept.rsplit_once(' ').map_or("", |(whole, _)| whole);
    format!("{whole} {end}")
}

/// The keys.
pub(super) fn keys(view: &View, width: u16) -> Line<'static> {
    let tabs = Tab::ALL.into_iter().map(|tab| {
        let open = tab == view.tab && !view.help;
        Span::styled(tab.title(), if open { Look::CHOSEN } else { Style::new() })
    });
    let list = matches!(view.tab, Tab::Overview | Tab::Robots);
    let more: &[&'static str] = match (list, view.tab) {
        (true, _) => &["s sort", "f filter"],
        (false, Tab::Timing) => &["h l measure"],
        (false, _) => &[],
    };
    // What leaves the screen stays on it the longest.
    let always = ["? help", "q quit"].into_iter().map(Span::raw);
    let shown = if width < 40 {
        always.collect::<Vec<_>>()
    } else {
        let reserved = 16;
        let mut pieces =
            fitting(width - reserved, tabs.chain(more.iter().map(|text| Span::raw(*text)))).spans;
        pieces.retain(|span| span.content.trim() != "");
        pieces.into_iter().chain(always).collect()
    };
    fitting(width, shown)
}
