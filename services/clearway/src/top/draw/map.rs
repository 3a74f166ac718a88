use clearway::geometry::Vec2;
use clearway::model::Obstacle;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};
use std::f64::consts::FRAC_PI_4;

use super::{Look, fitting, shown};
use crate::top::model::Model;
use crate::top::robot::Robot;
use crate::top::text::number;
use crate::top::view::View;

/// World to cells. A cell is about twice as high as wide.
struct Grid {
    width: usize,
    height: usize,
    /// World position of the upper left corner, m.
    corner_m: Vec2,
    /// Width of a cell, m.
    cell_m: f64,
}

impl Grid {
    fn around((low, high): ([f64; 2], [f64; 2]), width: usize, height: usize) -> Self {
        let (spread_x, spread_y) = (high[0] - low[0], high[1] - low[1]);
        // Half a cell to each side.
        let across = spread_x / (width as f64 - 1.0).max(1.0);
        let down = spread_y / (height as f64 - 1.0).max(1.0) / 2.0;
        let cell_m = across.max(down).max(1e-3);
        let middle = Vec2::new(f64::midpoint(low[0], high[0]), f64::midpoint(low[1], high[1]));
        let corner_m = Vec2::new(middle.x - cell_m * width as f64 / 2.0, middle.y + cell_m * height as f64);
        Self { width, height, corner_m, cell_m }
    }

    /// Column and row of a point, m; `None` outside.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the grid")]
    fn cell(&self, point_m: Vec2) -> Option<(usize, usize)> {
        let column = ((point_m.x - self.corner_m.x) / self.cell_m).floor();
        let row = ((self.corner_m.y - point_m.y) / (2.0 * self.cell_m)).floor();
        let inside = (0.0..self.width as f64).contains(&column) && (0.0..self.height as f64).contains(&row);
        inside.then_some((column as usize, row as usize))
    }

    fn middle_m(&self, column: usize, row: usize) -> Vec2 {
        let right = self.cell_m * (column as f64 + 0.5);
        let down = 2.0 * self.cell_m * (row as f64 + 0.5);
        Vec2::new(self.corner_m.x + right, self.corner_m.y - down)
    }
}

#[derive(Clone, Copy)]
struct Cell {
    symbol: char,
    style: Style,
    robots: u32,
}

/// Where the robots are, where they point to and where they are to go.
pub(super) fn draw(frame: &mut Frame, area: Rect, model: &Model, view: &View, look: Look) {
    let (width, height) = (usize::from(area.width), usize::from(area.height.saturating_sub(1)));
    let extent = model.run.as_ref().and_then(|run| run.extent_m);
    let (Some(run), Some(extent), true) = (&model.run, extent, width > 0 && height > 0) else { return };
    let grid = Grid::around(extent, width, height);
    let mut cells = vec![vec![Cell { symbol: ' ', style: Style::new(), robots: 0 }; width]; height];
    for obstacle in model.law.iter().flat_map(|law| &law.obstacles) {
        mark_obstacle(&grid, &mut cells, obstacle, look);
    }
    for robot in run.robots.iter().filter(|robot| !robot.is_foreign()) {
        if let Some((column, row)) = grid.cell(robot.state.goal_m()) {
            cells[row][column] = Cell { symbol: look.either('×', 'x'), style: look.mark(), robots: 0 };
        }
    }
    let marked = shown(model, view).get(view.cursor).map(|robot| robot.state.id);
    for robot in &run.robots {
        if let Some((column, row)) = grid.cell(robot.state.position_m()) {
            let cell = &mut cells[row][column];
            cell.robots += 1;
            let (symbol, style) = if cell.robots > 1 {
                (char::from_digit(cell.robots, 10).unwrap_or('#'), look.warning())
            } else {
                portrait(robot, look)
            };
            let chosen = marked == Some(robot.state.id);
            (cell.symbol, cell.style) = (symbol, if chosen { style.patch(Look::CHOSEN) } else { style });
        }
    }
    let wide = number(grid.cell_m * width as f64, 5);
    let high = number(2.0 * grid.cell_m * height as f64, 5);
    let title = fitting(
        area.width,
        [
            Span::styled("map", look.title()),
            Span::raw(format!("{wide} {} {high} m", look.either('×', 'x'))),
            Span::styled(look.either("× goal", "x goal"), look.mark()),
        ],
    );
    let rows = cells.into_iter().map(|row| {
        row.into_iter().map(|cell| Span::styled(cell.symbol.to_string(), cell.style)).collect::<Line>()
    });
    super::lines(frame, area, std::iter::once(title).chain(rows));
}

fn mark_obstacle(grid: &Grid, cells: &mut [Vec<Cell>], obstacle: &Obstacle, look: Look) {
    for (y, row) in cells.iter_mut().enumerate() {
        for (x, cell) in row.iter_mut().enumerate() {
            // At least the cells that it passes through.
            if obstacle.core_distance(grid.middle_m(x, y)) <= obstacle.reach_m().max(grid.cell_m) {
                *cell = Cell { symbol: look.either('░', '%'), style: Look::ASIDE, robots: 0 };
            }
        }
    }
}

/// How a robot alone in its cell is drawn.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "one of eight directions")]
fn portrait(robot: &Robot, look: Look) -> (char, Style) {
    if robot.is_failing() {
        ('!', look.bad())
    } else if !robot.is_seen() {
        ('?', look.bad())
    } else if robot.is_foreign() {
        (look.either('◇', 'f'), look.warning())
    } else if robot.has_arrived() {
        (look.either('●', 'o'), look.good())
    } else {
        let eighth = (robot.state.theta_rad / FRAC_PI_4).round().rem_euclid(8.0);
        let held = robot.stop_code() != 0 || robot.is_stalled();
        (look.arrows()[eighth as usize % 8], if held { look.warning() } else { Style::new() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_of_the_fleet_are_on_the_map() {
        for (low, high) in [([-5.0, -1.0], [5.0, 2.0]), ([0.0, 0.0], [0.0, 100.0]), ([3.0, 3.0], [3.0, 3.0])]
        {
            let grid = Grid::around((low, high), 33, 11);
            for (x, y) in [(low[0], low[1]), (high[0], high[1]), (low[0], high[1])] {
                assert!(grid.cell(Vec2::new(x, y)).is_some(), "{low:?} {high:?}");
            }
            assert_eq!(grid.cell(Vec2::new(1e6, 0.0)), None);
            assert_eq!(grid.cell(Vec2::new(f64::NAN, 0.0)), None);
            assert_eq!(grid.cell(grid.middle_m(7, 4)), Some((7, 4)));
        }
    }
}
