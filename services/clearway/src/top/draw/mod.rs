//! The screen. Every text is either shown whole or left out: nothing is cut in the middle, from 80 × 24 on
//! nothing is left out. Without colours and without Unicode it says the same.

mod attached;
mod header;
mod help;
mod look;
mod map;
mod table;
mod timing;

pub(crate) use look::Look;

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use super::model::Model;
use super::robot::listed;
use super::text::columns;
use super::view::{Tab, View};

/// Where things are drawn, from the top down.
struct Page {
    left: Rect,
}

impl Page {
    /// The next `height` lines, or fewer where there are no more.
    fn take(&mut self, height: u16) -> Rect {
        let height = height.min(self.left.height);
        let taken = Rect { height, ..self.left };
        self.left.y += height;
        self.left.height -= height;
        taken
    }
}

/// A part of `area`, and nothing outside of it.
fn part(area: Rect, x: u16, width: u16) -> Rect {
    let x = x.min(area.width);
    Rect { x: area.x + x, width: width.min(area.width - x), ..area }
}

/// Draws lines from the top of `area`.
fn lines<'a>(frame: &mut Frame, area: Rect, lines: impl IntoIterator<Item = Line<'a>>) {
    for (y, line) in (0..area.height).zip(lines) {
        frame.render_widget(line, Rect { y: area.y + y, height: 1, ..area });
    }
}

/// The pieces that fit beside each other, two columns apart; those that do not fit are left out.
fn fitting<'a>(width: u16, pieces: impl IntoIterator<Item = Span<'a>>) -> Line<'a> {
    let mut room = usize::from(width);
    let mut line = Line::default();
    for piece in pieces {
        let gap = if line.spans.is_empty() { 0 } else { 2 };
        let needed = columns(&piece.content) + gap;
        if needed <= room {
            room -= needed;
            if gap > 0 {
                line.push_span(Span::raw("  "));
            }
            line.push_span(piece);
        }
    }
    line
}

/// Draws everything as of `now_ns`.
pub(crate) fn screen(frame: &mut Frame, model: &Model, view: &mut View, look: Look, now_ns: u64) {
    let mut page = Page { left: frame.area() };
    let footer_height = u16::from(frame.area().height > 4);
    page.left.height -= footer_height;
    let footer = Rect { y: page.left.y + page.left.height, height: footer_height, ..page.left };
    let head = page.take(3);
    lines(frame, head, header::lines(model, look, now_ns, head.width));
    lines(frame, footer, [header::keys(view, footer.width)]);
    let body = page.left;
    if view.help {
        help::draw(frame, body, look);
        return;
    }
    match view.tab {
        Tab::Overview => overview(frame, body, model, view, look, now_ns),
        Tab::Robots => robots(frame, body, model, view, look),
        Tab::Timing => timing::draw(frame, body, model, view, look, now_ns),
        Tab::Attached => attached::draw(frame, body, model, look),
    }
}

/// Columns below which the map makes room for the table.
const MAP_WIDTH_MIN: u16 = 20;
/// The narrowest table that says what matters.
const TABLE_WIDTH: u16 = 46;

fn overview(frame: &mut Frame, body: Rect, model: &Model, view: &mut View, look: Look, now_ns: u64) {
    let facts = timing::facts(model, look, body.width);
    let below = timing::COMPACT_LINES + u16::try_from(facts.len()).unwrap_or(0);
    let mut page = Page { left: body };
    // The list comes first where there is not enough room for all of it.
    let upper = page.take(body.height.saturating_sub(below).max(6));
    let map_width = upper.width.saturating_sub(TABLE_WIDTH + 1);
    let table_width = if map_width < MAP_WIDTH_MIN {
        upper.width
    } else {
        // Twice as many columns as rows make a square.
        let map_width = map_width.min(upper.height.saturating_mul(3)).min(upper.width / 2);
        map::draw(frame, part(upper, 0, map_width), model, view, look);
        upper.width - map_width - 1
    };
    let list = part(upper, upper.width - table_width, table_width);
    table::draw(frame, list, model, view, look);
    timing::compact(frame, page.take(timing::COMPACT_LINES), model, look, now_ns);
    lines(frame, page.left, facts);
}

fn robots(frame: &mut Frame, body: Rect, model: &Model, view: &mut View, look: Look) {
    table::draw(frame, body, model, view, look);
}

/// The robots that are shown, and the one that is marked.
fn shown<'a>(model: &'a Model, view: &View) -> Vec<&'a super::robot::Robot> {
    model.run.as_ref().map(|run| listed(&run.robots, view.sort, view.filter)).unwrap_or_default()
}
