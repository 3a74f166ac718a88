//! Strokes, shapes and letters, in px with the origin at the upper left.

use super::style::{Colour, FONTS, Marker, Style};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::element::{Circle, DashedPathElement, PathElement, Polygon, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontTransform, IntoFont, RGBAColor, ShapeStyle};
use plotters_svg::SVGBackend;

/// Plotters draws on whole units: this many of them are a px.
pub(super) const UNITS: f64 = 8.0;

/// Where a text's position is on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Align {
    Left,
    Centre,
    Right,
    /// Upwards, centred.
    Upwards,
}

/// A sheet that things are drawn on.
pub(super) struct Canvas<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

/// Writing to a string cannot fail, and a sheet is nothing else.
fn drawn<T, E>(_: Result<T, E>) {}

#[allow(clippy::cast_possible_truncation)] // sheets are small
fn units((x, y): (f64, f64)) -> (i32, i32) {
    ((x * UNITS).round() as i32, (y * UNITS).round() as i32)
}

fn colour(c: Colour, opacity: f64) -> RGBAColor {
    RGBAColor(c.0, c.1, c.2, opacity)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // widths are small and positive
fn stroke(c: Colour, width_px: f64) -> ShapeStyle {
    ShapeStyle {
        color: colour(c, 1.0),
        filled: false,
        stroke_width: (width_px * UNITS).round().max(1.0) as u32,
    }
}

impl Canvas<'_> {
    /// Draws on a sheet of `size_px` what `on` draws, and gives its SVG.
    pub(super) fn sheet(title: &str, size_px: (f64, f64), on: impl FnOnce(&Canvas<'_>)) -> String {
        let mut text = String::new();
        let (width, height) = units(size_px);
        let size = (width.unsigned_abs(), height.unsigned_abs());
        {
            let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
            let canvas = Canvas { area };
            drawn(canvas.area.fill(&plotters::style::WHITE));
            on(&canvas);
            drawn(canvas.area.present());
        }
        // The same sheet at its size in px, with its title for readers that do not see it, the font
        // said once, and without what is the default anyway.
        let head = format!("<svg width=\"{}\" height=\"{}\" ", size.0, size.1);
        let family = format!(" font-family=\"{FONTS}\"");
        let (width, height) = size_px;
        let sheet = format!("<svg role=\"img\" width=\"{width}\" height=\"{height}\"{family} ");
        let text = text.replace(&family, "").replace(" opacity=\"1\"", "").replace(" \"/>", "\"/>");
        let text = text.replacen(&head, &sheet, 1);
        text.replacen(">\n", &format!(">\n<title>{}</title>\n", escaped(title)), 1)
    }

    /// A line through `points`.
    pub(super) fn path(&self, points: &[(f64, f64)], style: &Style) {
        if points.len() < 2 {
            return;
        }
        let through: Vec<(i32, i32)> = simplified(points).into_iter().map(units).collect();
        let pen = stroke(style.colour, style.width_px);
        match style.dash.lengths_px() {
            None => drawn(self.area.draw(&PathElement::new(through, pen))),
            Some((dash, gap)) => {
                let (dash, gap) = units((dash, gap));
                drawn(self.area.draw(&DashedPathElement::new(through, dash, gap, pen)));
            }
        }
    }

    /// A filled shape.
    pub(super) fn fill(&self, corners: &[(f64, f64)], c: Colour, opacity: f64) {
        let corners: Vec<(i32, i32)> = corners.iter().copied().map(units).collect();
        drawn(self.area.draw(&Polygon::new(corners, colour(c, opacity).filled())));
    }

    /// A disc, filled where `opacity` is not 0, and its rim.
    pub(super) fn disc(&self, centre: (f64, f64), radius_px: f64, c: Colour, opacity: f64, rim_px: f64) {
        let (radius, _) = units((radius_px, 0.0));
        if opacity > 0.0 {
            drawn(self.area.draw(&Circle::new(units(centre), radius, colour(c, opacity).filled())));
        }
        if rim_px > 0.0 {
            drawn(self.area.draw(&Circle::new(units(centre), radius, stroke(c, rim_px))));
        }
    }

    /// A mark about `size_px` wide.
    pub(super) fn mark(&self, at: (f64, f64), marker: Marker, c: Colour, size_px: f64) {
        let r = 0.5 * size_px;
        let corner = |dx: f64, dy: f64| (at.0 + r * dx, at.1 + r * dy);
        let pen = Style::solid(c).wide(0.3 * size_px);
        let fill = |corners: &[(f64, f64)]| {
            self.fill(&corners.iter().map(|(x, y)| corner(*x, *y)).collect::<Vec<_>>(), c, 1.0);
        };
        match marker {
            Marker::Disc => self.disc(at, r, c, 1.0, 0.0),
            Marker::Ring => self.disc(at, r, c, 0.0, 0.2 * size_px),
            Marker::Square => fill(&[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)]),
            Marker::Triangle => fill(&[(0.0, -1.15), (1.05, 0.75), (-1.05, 0.75)]),
            Marker::Diamond => fill(&[(0.0, -1.2), (1.2, 0.0), (0.0, 1.2), (-1.2, 0.0)]),
            Marker::Cross => {
                self.path(&[corner(-1.0, -1.0), corner(1.0, 1.0)], &pen);
                self.path(&[corner(-1.0, 1.0), corner(1.0, -1.0)], &pen);
            }
        }
    }

    /// Words, their middle at the height `at.1`.
    pub(super) fn text(&self, words: &str, at: (f64, f64), size_px: f64, align: Align, c: Colour) {
        let horizontal = match align {
            Align::Left => HPos::Left,
            Align::Centre | Align::Upwards => HPos::Center,
            Align::Right => HPos::Right,
        };
        // Plotters divides sizes by this to come from heights to ems.
        let font = (FONTS, size_px * UNITS * 1.24).into_font();
        let font = if align == Align::Upwards { font.transform(FontTransform::Rotate270) } else { font };
        let style = font.color(&colour(c, 1.0)).pos(Pos::new(horizontal, VPos::Center));
        drawn(self.area.draw(&Text::new(words.to_owned(), units(at), style)));
    }
}

/// The line without the points that nobody would miss (Ramer, Douglas and Peucker).
fn simplified(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    const MISSED_PX: f64 = 0.06;
    let mut kept = vec![false; points.len()];
    let last = points.len() - 1;
    (kept[0], kept[last]) = (true, true);
    let mut open = vec![(0, last)];
    while let Some((from, to)) = open.pop() {
        let (a, b) = (points[from], points[to]);
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let off = |p: (f64, f64)| {
            let along = (p.0 - a.0) * dx + (p.1 - a.1) * dy;
            let t = (along / (dx * dx + dy * dy).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            (p.0 - a.0 - t * dx).hypot(p.1 - a.1 - t * dy)
        };
        let between = (from + 1..to).map(|k| (k, off(points[k])));
        if let Some((k, _)) = between.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, px)| *px > MISSED_PX) {
            kept[k] = true;
            open.extend([(from, k), (k, to)]);
        }
    }
    points.iter().zip(kept).filter_map(|(point, kept)| kept.then_some(*point)).collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
