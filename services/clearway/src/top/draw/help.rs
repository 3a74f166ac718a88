use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::Line;

use super::Look;
use super::header::abridged;

const HELP: [&str; 20] = [
    "1 2 3 4, Tab  views: overview, robots, timing, who is attached",
    "s             order: worst slack, stopped, farthest, slowest solve, id",
    "f             show: all, away from their goals, standing",
    "up down j k   mark a robot; PgUp PgDn by pages, g first, G last",
    "h l           which time is drawn in the timing view",
    "? Esc         open and close this; q or Ctrl-C ends, Ctrl-Z suspends",
    "",
    "map           an arrow is a robot and its heading, x where it is to go,",
    "              a filled dot has arrived, ! stands for a fault, ? has no",
    "              trusted state, a digit is several robots in one place",
    "V m2          what is left to the goal, half the distance squared",
    "dp m2, dth    slacks: what the certificates fell short of their decrease,",
    "              of position and heading; a robot gives way with them",
    "status        drives, arrived, gives way, stalled, or why it was stopped",
    "times         release lateness: planned start of a period to awake;",
    "              solve: the solver alone; state to command: published",
    "distribution  logarithmic both ways: a single late period is visible",
    "since start   the daemon's own count; watched: since this monitor came",
    "not read      samples that this monitor was too slow for: the loop never",
    "              waits for it, and nothing it does changes control",
];

/// What keys do and what the columns mean.
pub(super) fn draw(frame: &mut Frame, area: Rect, look: Look) {
    let width = usize::from(area.width);
    super::lines(frame, area, HELP.iter().map(|text| Line::raw(abridged(text, width, look))));
}
