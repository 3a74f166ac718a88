use clearway::geometry::wrap;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use super::{Look, fitting, shown};
use crate::top::model::Model;
use crate::top::robot::Robot;
use crate::top::text::{NOTHING, fixed, number, time};
use crate::top::view::View;

/// A column of the list.
struct Column {
    title: &'static str,
    ascii: &'static str,
    width: usize,
    /// Who makes room first: the larger.
    rank: usize,
    cell: fn(&Robot, Look) -> String,
}

/// A number of telemetry.
fn told(robot: &Robot, width: usize, of: fn(&clearway::wire::RobotTelemetry) -> f64) -> String {
    robot.telemetry.map_or_else(|| NOTHING.to_owned(), |telemetry| number(of(&telemetry), width))
}

const COLUMNS: [Column; 16] = [
    Column { title: "id", ascii: "id", width: 5, rank: 0, cell: |r, _| r.state.id.to_string() },
    Column { title: "x m", ascii: "x m", width: 6, rank: 7, cell: |r, _| fixed(r.state.x_m, 6) },
    Column { title: "y m", ascii: "y m", width: 6, rank: 8, cell: |r, _| fixed(r.state.y_m, 6) },
    Column {
        title: "θ °",
        ascii: "deg",
        width: 4,
        rank: 9,
        cell: |r, _| format!("{:.0}", wrap(r.state.theta_rad).to_degrees()),
    },
    Column { title: "v m/s", ascii: "v m/s", width: 5, rank: 3, cell: |r, _| fixed(r.state.v_mps, 5) },
    Column {
        title: "ω 1/s", ascii: "w 1/s", width: 6, rank: 11, cell: |r, _| fixed(r.state.omega_radps, 6)
    },
    Column {
        title: "goal m",
        ascii: "goal m",
        width: 6,
        rank: 2,
        cell: |r, _| r.goal_away_m().map_or_else(|| NOTHING.to_owned(), |m| fixed(m, 6)),
    },
    Column {
        title: "V m²",
        ascii: "V m2",
        width: 7,
        rank: 10,
        cell: |r, _| told(r, 7, |t| t.lyapunov_position_m2),
    },
    Column {
        title: "δp m²",
        ascii: "dp m2",
        width: 7,
        rank: 4,
        cell: |r, _| told(r, 7, |t| t.slack_position_m2),
    },
    Column {
        title: "δθ", ascii: "dtheta", width: 7, rank: 5, cell: |r, _| told(r, 7, |t| t.slack_heading)
    },
    Column {
        title: "δr m",
        ascii: "dr m",
        width: 7,
        rank: 13,
        cell: |r, _| told(r, 7, |t| t.slack_comfort_m),
    },
    Column {
        title: "clear m",
        ascii: "clear m",
        width: 7,
        rank: 12,
        cell: |r, _| told(r, 7, |t| t.clearance_m),
    },
    Column {
        title: "rows",
        ascii: "rows",
        width: 4,
        rank: 14,
        cell: |r, _| r.telemetry.map_or_else(|| NOTHING.to_owned(), |t| t.safety_rows.to_string()),
    },
    Column {
        title: "solve",
        ascii: "solve",
        width: 7,
        rank: 6,
        cell: |r, look| r.telemetry.map_or_else(|| NOTHING.to_owned(), |t| time(t.solve_ns, look.ascii)),
    },
    Column {
        title: "step",
        ascii: "step",
        width: 7,
        rank: 15,
        cell: |r, look| r.telemetry.map_or_else(|| NOTHING.to_owned(), |t| time(t.step_ns, look.ascii)),
    },
    Column { title: "status", ascii: "status", width: 10, rank: 1, cell: |r, _| r.status().to_owned() },
];

/// The columns that fit, in the order of the table; the more important ones first.
fn columns(width: usize) -> Vec<&'static Column> {
    let mut by_rank: Vec<&Column> = COLUMNS.iter().collect();
    by_rank.sort_by_key(|column| column.rank);
    let mut room = width + 1;
    let mut least = usize::MAX;
    for column in by_rank {
        if column.width >= room {
            break;
        }
        room -= column.width + 1;
        least = column.rank;
    }
    COLUMNS.iter().filter(|column| least != usize::MAX && column.rank <= least).collect()
}

/// A list of the robots, one a line, below a line that says which and in what order.
pub(super) fn draw(frame: &mut Frame, area: Rect, model: &Model, view: &mut View, look: Look) {
    let robots = shown(model, view);
    let page = usize::from(area.height.saturating_sub(2));
    view.settle(robots.len(), page);
    let first = if robots.is_empty() { 0 } else { view.top + 1 };
    let last = (view.top + page).min(robots.len());
    let title = fitting(
        area.width,
        [
            Span::styled(format!("robots {first}-{last} of {}", robots.len()), look.title()),
            Span::raw(view.sort.title()),
            Span::raw(view.filter.title()),
        ],
    );
    let columns = columns(area.width.into());
    let aligned = |column: &Column, text: &str| {
        // The last column is a word.
        if column.rank == 1 {
            format!("{text:<width$}", width = column.width)
        } else {
            format!("{text:>width$}", width = column.width)
        }
    };
    let heads: Vec<String> =
        columns.iter().map(|column| aligned(column, look.either(column.title, column.ascii))).collect();
    let rows = robots.iter().enumerate().skip(view.top).take(page).map(|(index, robot)| {
        let cells: Vec<String> =
            columns.iter().map(|column| aligned(column, &(column.cell)(robot, look))).collect();
        let style = if robot.is_failing() || !robot.is_seen() {
            look.bad()
        } else if robot.stop_code() != 0 || robot.is_stalled() && !robot.has_arrived() {
            look.warning()
        } else {
            Style::new()
        };
        let style = if index == view.cursor { style.patch(Look::CHOSEN) } else { style };
        Line::styled(cells.join(" "), style)
    });
    let head = Line::styled(heads.join(" "), Look::ASIDE);
    super::lines(frame, area, [title, head].into_iter().chain(rows));
}
