//! A figure: panels in a grid under one legend.

use super::canvas::{Align, Canvas};
use super::panel::{Frame, Panel, Sample};
use super::style::{Colour, TEXT_PX, width_px};

/// Width of a whole figure, px.
const WIDTH_PX: f64 = 720.0;

/// Length of a line in the legend, px.
const SAMPLE_PX: f64 = 30.0;

/// Panels in a grid under one legend.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Figure {
    title: String,
    columns: usize,
    width_px: f64,
    panel_height_px: f64,
    panels: Vec<Panel>,
}

/// A figure, drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rendered {
    /// The SVG.
    pub(crate) svg: String,
    /// Where each panel's axes came to stand, px.
    pub(crate) frames: Vec<Frame>,
    /// Units of the SVG's coordinates in a px.
    pub(crate) units_per_px: f64,
}

impl Figure {
    /// An empty figure. Its title is for readers that cannot see it; the words around a figure say
    /// the same to the others.
    pub(crate) fn new(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            columns: 1,
            width_px: WIDTH_PX,
            panel_height_px: 300.0,
            panels: Vec::new(),
        }
    }

    /// In so many columns.
    #[must_use]
    pub(crate) fn columns(self, columns: usize) -> Self {
        Self { columns: columns.max(1), ..self }
    }

    /// With panels of this height, labels included, px.
    #[must_use]
    pub(crate) fn panel_height(self, panel_height_px: f64) -> Self {
        Self { panel_height_px, ..self }
    }

    /// As wide as this, px.
    #[must_use]
    pub(crate) fn width(self, width_px: f64) -> Self {
        Self { width_px, ..self }
    }

    /// With one panel more.
    #[must_use]
    pub(crate) fn with(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// What the lines and marks stand for, as CSV with one point a row, to draw it with other tools.
    pub(crate) fn csv(&self) -> String {
        let mut out = "panel,series,x_axis,y_axis,x,y\n".to_owned();
        for (k, panel) in self.panels.iter().enumerate() {
            panel.rows(k + 1, &mut out);
        }
        out
    }

    /// The figure as SVG: the same bytes for the same figure.
    pub(crate) fn svg(&self) -> String {
        self.render().svg
    }

    /// The figure as SVG, and where its panels are on it.
    pub(crate) fn render(&self) -> Rendered {
        let legend = self.legend();
        let legend_px = legend.iter().map(|(at, ..)| at.1 + 1.1 * TEXT_PX).fold(0.0, f64::max);
        let rows = self.panels.len().div_ceil(self.columns);
        let panel = (self.width_px / self.columns as f64, self.panel_height_px);
        let size = (self.width_px, (legend_px + rows as f64 * panel.1 + 4.0).ceil());
        // Axes below each other begin at the same place.
        let left = self.panels.iter().map(|content| content.left_px(panel.1)).fold(0.0, f64::max);
        let mut frames = Vec::new();
        let svg = Canvas::sheet(&self.title, size, |canvas| {
            for (at, name, sample) in &legend {
                draw_sample(canvas, *at, name, sample);
            }
            for (k, content) in self.panels.iter().enumerate() {
                let (column, row) = (k % self.columns, k / self.columns);
                let origin = (column as f64 * panel.0, legend_px + row as f64 * panel.1);
                frames.push(content.draw(canvas, origin, panel, left));
            }
        });
        Rendered { svg, frames, units_per_px: super::canvas::UNITS }
    }

    /// The entries of all panels, each name once, set in rows; where each begins, px.
    fn legend(&self) -> Vec<((f64, f64), &str, &Sample)> {
        let mut placed: Vec<((f64, f64), &str, &Sample)> = Vec::new();
        let margin = 16.0;
        let (mut x, mut y) = (margin, 1.2 * TEXT_PX);
        for (name, sample) in self.panels.iter().flat_map(Panel::legend) {
            if placed.iter().any(|(_, known, _)| known == name) {
                continue;
            }
            let width = SAMPLE_PX + 6.0 + width_px(name, TEXT_PX) + 16.0;
            if x + width > self.width_px && x > margin {
                (x, y) = (margin, y + 1.5 * TEXT_PX);
            }
            placed.push(((x, y), name, sample));
            x += width;
        }
        placed
    }
}

fn draw_sample(canvas: &Canvas<'_>, at: (f64, f64), name: &str, sample: &Sample) {
    let middle = (at.0 + 0.5 * SAMPLE_PX, at.1);
    match sample {
        Sample::Line(style) => {
            canvas.path(&[at, (at.0 + SAMPLE_PX, at.1)], style);
            if let Some(marker) = style.marker {
                canvas.mark(middle, marker, style.colour, 6.0);
            }
        }
        Sample::Band(colour) => {
            let (l, r, half) = (at.0, at.0 + SAMPLE_PX, 0.4 * TEXT_PX);
            let (top, bottom) = (at.1 - half, at.1 + half);
            canvas.fill(&[(l, top), (r, top), (r, bottom), (l, bottom)], *colour, 0.25);
        }
        Sample::Mark(marker, colour, size_px) => canvas.mark(middle, *marker, *colour, *size_px),
    }
    let beside = (at.0 + SAMPLE_PX + 6.0, at.1);
    canvas.text(name, beside, TEXT_PX, Align::Left, Colour::INK);
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, Marker, Style};
    use super::*;

    fn sample() -> Figure {
        let mut over_time = Panel::new(Axis::linear("time", "s").from(0.0), Axis::log("solve time", "ns"))
            .titled("a < b & c");
        let rising = |k: f64| (0..200).map(|i| (f64::from(i), k * 1.03f64.powi(i))).collect();
        for k in 0..4 {
            over_time.line(
                &format!("line {k}"),
                rising(10f64.powi(k)),
                Style::nth(usize::try_from(k).unwrap_or(0)),
            );
        }
        over_time.level(1e4, "the budget");
        let mut plane = Panel::plane();
        plane.disc((0.0, 0.0), 1.0, Colour::SOLID, true);
        plane.marks("contact", &[(0.0, 0.0), (9.0, 9.0)], Marker::Cross, Colour::ALARM, 8.0);
        Figure::new("a sample").columns(2).with(over_time).with(plane)
    }

    #[test]
    fn a_figure_is_sound_xml_with_its_labels_and_the_same_bytes_every_time() {
        let svg = sample().svg();
        assert_eq!(svg, sample().svg());
        let tree = roxmltree::Document::parse(&svg).unwrap();
        let texts: Vec<&str> = tree
            .descendants()
            .filter(|n| n.has_tag_name("text"))
            .filter_map(|n| n.text().map(str::trim))
            .collect();
        for words in
            ["time [s]", "solve time [ns]", "x [m]", "y [m]", "line 3", "contact", "a < b & c", "10000"]
        {
            assert!(texts.contains(&words), "{words}: {texts:?}");
        }
        assert_eq!(texts.iter().filter(|t| **t == "contact").count(), 1, "one entry for a name");
        assert!(svg.len() < 120_000, "{} bytes", svg.len());
        assert!(!svg.contains("NaN"));
    }

    #[test]
    fn a_metre_is_as_long_on_both_axes_of_a_plane() {
        let rendered = sample().render();
        let frame = &rendered.frames[1];
        let (origin, right, up) =
            (frame.px((0.0, 0.0)).unwrap(), frame.px((1.0, 0.0)).unwrap(), frame.px((0.0, 1.0)).unwrap());
        assert!(((right.0 - origin.0) - (origin.1 - up.1)).abs() < 1e-9);
        assert!((right.0 - origin.0 - frame.px_per_unit()).abs() < 1e-9);
    }

    #[test]
    fn the_data_beside_a_figure_is_what_it_shows() {
        let csv = sample().csv();
        let mut rows = csv.lines();
        assert_eq!(rows.next(), Some("panel,series,x_axis,y_axis,x,y"));
        assert_eq!(rows.next(), Some("a < b & c,line 0,time [s],solve time [ns],0,1"));
        assert_eq!(rows.clone().filter(|row| row.contains(",line 3,")).count(), 200);
        assert_eq!(rows.last(), Some("2,contact,x [m],y [m],9,9"));
    }

    #[test]
    fn nothing_is_drawn_outside_of_the_frame() {
        let mut panel =
            Panel::new(Axis::linear("x", "").from(0.0).to(1.0), Axis::linear("y", "").from(0.0).to(1.0));
        panel.curve(
            "",
            vec![(-5.0, 0.5), (5.0, 0.5), (f64::NAN, 0.5), (0.5, -7.0), (0.5, 9.0)],
            Style::solid(Colour::INK),
        );
        let rendered = Figure::new("clipped").with(panel).render();
        let (frame, units) = (&rendered.frames[0], rendered.units_per_px);
        let tree = roxmltree::Document::parse(&rendered.svg).unwrap();
        for line in tree.descendants().filter(|n| n.has_tag_name("polyline")) {
            for point in line.attribute("points").unwrap_or_default().split_whitespace() {
                let (x, y) = point.split_once(',').unwrap();
                let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
                let inside = (frame.left * units - 1.0..=frame.right * units + 1.0).contains(&x)
                    && (frame.top * units - 1.0..=frame.bottom * units + 1.0).contains(&y);
                assert!(inside, "{point}");
            }
        }
    }
}
