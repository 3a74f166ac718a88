use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use super::header::abridged;
use super::{Look, fitting};
use crate::top::model::Model;
use crate::top::text::columns;

/// How many read and write, this monitor among them.
fn counts(model: &Model) -> Option<[(&'static str, &'static str, u64); 5]> {
    let told = model.status.as_ref().filter(|_| model.unanswered.is_none()).map(|status| &status.figures);
    let found = model.ports.as_ref();
    // The daemon knows which readers are its own.
    let state = told.map(|f| u64::from(f.state_readers)).or(found.map(|p| p.state_readers as u64))?;
    let found = found?;
    Some([
        ("state", "readers", state),
        ("command", "readers", found.command_readers as u64),
        ("telemetry", "readers", found.telemetry_readers as u64),
        ("observation", "writers", found.observation_writers as u64),
        ("admin", "clients", found.admin_clients as u64),
    ])
}

/// The counts in one line's pieces.
pub(super) fn short(model: &Model) -> Vec<String> {
    let Some(counts) = counts(model) else { return vec!["-".to_owned()] };
    let names = ["state", "cmd", "tel", "obs", "admin"];
    names.into_iter().zip(counts).map(|(name, (_, _, n))| format!("{name} {n}")).collect()
}

/// Who is attached, what the daemon falls short in and what is in force.
pub(super) fn draw(frame: &mut Frame, area: Rect, model: &Model, look: Look) {
    let width = usize::from(area.width);
    let mut lines: Vec<Line> = Vec::new();
    lines.push(fitting(
        area.width,
        [
            Span::styled("attached", look.title()),
            Span::styled("this monitor among them, the daemon's own not", Look::ASIDE),
        ],
    ));
    for (channel, what, n) in counts(model).into_iter().flatten() {
        let what = if n == 1 { what.trim_end_matches('s') } else { what };
        lines.push(Line::raw(format!("  {channel:<12}{n:>4} {what}")));
    }
    lines.push(Line::styled("processes", look.title()));
    for (process, executable, roles) in processes(model) {
        let who = format!("  {process:>8}  {executable:<12}  ");
        let roles = abridged(&roles, width.saturating_sub(columns(&who)), look);
        lines.push(Line::from(vec![Span::raw(who), Span::styled(roles, Look::ASIDE)]));
    }
    if let Some(status) = &model.status {
        let f = &status.figures;
        lines.push(fitting(
            area.width,
            [
                Span::styled("requests", look.title()),
                Span::raw(format!("{} done", f.requests_done)),
                Span::raw(format!("{} refused", f.requests_refused)),
                Span::raw(format!("{} busy", f.requests_busy)),
            ],
        ));
        let title = if status.degraded.is_empty() { "real time as configured" } else { "DEGRADED" };
        lines.push(Line::styled(title, look.title()));
        for reason in &status.degraded {
            let wrapped = textwrap::wrap(reason, width.saturating_sub(2).max(10));
            lines.extend(wrapped.into_iter().map(|line| Line::raw(format!("  {line}"))));
        }
    }
    if let Some(law) = &model.law {
        lines.push(fitting(
            area.width,
            [
                Span::styled("in force", look.title()),
                Span::raw(format!("scenario {}", law.scenario)),
                Span::raw(format!("profile {}", law.profile)),
                Span::raw(format!("solver {}", law.solver)),
                Span::raw(format!("realtime {}", law.policy)),
            ],
        ));
    }
    let room = usize::from(area.height);
    if lines.len() > room && room > 0 {
        let hidden = lines.len() - room + 1;
        lines.truncate(room - 1);
        lines.push(Line::raw(format!("{} {hidden} more lines", look.either("…", "..."))));
    }
    lines.retain(|line| line.spans.iter().map(|span| columns(&span.content)).sum::<usize>() <= width);
    super::lines(frame, area, lines);
}

/// Each process once, with what its threads called themselves.
fn processes(model: &Model) -> Vec<(i32, String, String)> {
    let mut found: Vec<(i32, String, Vec<String>)> = Vec::new();
    for member in &model.members {
        // The daemon's threads repeat its name.
        let role = member.role.strip_prefix(&format!("{}-", member.executable)).unwrap_or(&member.role);
        match found.last_mut().filter(|(process, _, _)| *process == member.process) {
            Some((_, _, roles)) if roles.iter().any(|known| known == role) => {}
            Some((_, _, roles)) => roles.push(role.to_owned()),
            None => found.push((member.process, member.executable.clone(), vec![role.to_owned()])),
        }
    }
    found.into_iter().map(|(process, executable, roles)| (process, executable, roles.join(", "))).collect()
}
