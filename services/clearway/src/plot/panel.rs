//! One panel: two axes and what is drawn between them.

use super::axis::Axis;
use super::canvas::{Align, Canvas};
use super::style::{Colour, Dash, Marker, SMALL_PX, Style, TEXT_PX, width_px};
use std::fmt::Write;

/// Points in the units of the axes.
type Points = Vec<(f64, f64)>;

#[derive(Debug, Clone, PartialEq)]
enum Item {
    Line { name: String, points: Points, style: Style },
    Band { low: Points, high: Points, colour: Colour },
    Disc { centre: (f64, f64), radius: f64, colour: Colour, filled: bool },
    Mark { name: String, at: (f64, f64), marker: Marker, colour: Colour, size_px: f64 },
    Level { at: f64, words: String },
    Moment { at: f64, words: String },
    Note { at: (f64, f64), words: String },
    Room(Points),
}

/// An entry of the legend.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Sample {
    Line(Style),
    Mark(Marker, Colour, f64),
    Band(Colour),
}

/// Two axes and what is drawn between them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Panel {
    title: String,
    x: Axis,
    y: Axis,
    equal: bool,
    items: Vec<Item>,
    legend: Vec<(String, Sample)>,
}

impl Panel {
    /// An empty panel.
    pub(crate) fn new(x: Axis, y: Axis) -> Self {
        Self { title: String::new(), x, y, equal: false, items: Vec::new(), legend: Vec::new() }
    }

    /// A piece of the plane: a metre is as long on both axes.
    pub(crate) fn plane() -> Self {
        Self { equal: true, ..Self::new(Axis::linear("x", "m"), Axis::linear("y", "m")) }
    }

    /// With a title above it.
    #[must_use]
    pub(crate) fn titled(self, title: &str) -> Self {
        Self { title: title.to_owned(), ..self }
    }

    /// A line through `points`, in the legend under `name`.
    pub(crate) fn line(&mut self, name: &str, points: Points, style: Style) {
        self.sample(name, Sample::Line(style));
        self.curve(name, points, style);
    }

    /// A line that is not in the legend; its name is for the data beside the figure.
    pub(crate) fn curve(&mut self, name: &str, points: Points, style: Style) {
        self.items.push(Item::Line { name: name.to_owned(), points, style });
    }

    /// The space between two lines that have the same abscissae, in the legend under `name`.
    pub(crate) fn band(&mut self, name: &str, low: Points, high: Points, colour: Colour) {
        self.sample(name, Sample::Band(Colour::FAINT));
        self.items.push(Item::Band { low, high, colour });
    }

    /// A disc whose radius is in the axes' unit.
    pub(crate) fn disc(&mut self, centre: (f64, f64), radius: f64, colour: Colour, filled: bool) {
        self.items.push(Item::Disc { centre, radius, colour, filled });
    }

    /// Marks, in the legend under `name`, whether there is one or not; no name, no entry.
    pub(crate) fn marks(
        &mut self,
        name: &str,
        at: &[(f64, f64)],
        marker: Marker,
        colour: Colour,
        size_px: f64,
    ) {
        if !name.is_empty() {
            self.sample(name, Sample::Mark(marker, colour, size_px));
        }
        let mark = |at: &(f64, f64)| Item::Mark { name: name.to_owned(), at: *at, marker, colour, size_px };
        self.items.extend(at.iter().map(mark));
    }

    /// A horizontal reference line with words above its left end.
    pub(crate) fn level(&mut self, at: f64, words: &str) {
        self.items.push(Item::Level { at, words: words.to_owned() });
    }

    /// A vertical reference line with words along its lower end.
    pub(crate) fn moment(&mut self, at: f64, words: &str) {
        self.items.push(Item::Moment { at, words: words.to_owned() });
    }

    /// Places that the axes have to hold, whether something is drawn there or not.
    pub(crate) fn room(&mut self, places: Points) {
        self.items.push(Item::Room(places));
    }

    /// Words centred at a place.
    pub(crate) fn note(&mut self, at: (f64, f64), words: &str) {
        self.items.push(Item::Note { at, words: words.to_owned() });
    }

    fn sample(&mut self, name: &str, sample: Sample) {
        if self.legend.iter().all(|(known, _)| known != name) {
            self.legend.push((name.to_owned(), sample));
        }
    }

    /// The lines and marks as rows of a table: panel, series, x, y, each with what the axes measure.
    pub(super) fn rows(&self, number: usize, out: &mut String) {
        let title = if self.title.is_empty() { number.to_string() } else { self.title.clone() };
        let head = |series: &str| [&title, series, self.x.label(), self.y.label()].map(quoted).join(",");
        for item in &self.items {
            let (name, points) = match item {
                Item::Line { name, points, .. } if !name.is_empty() => (name.as_str(), points.as_slice()),
                Item::Mark { name, at, .. } if !name.is_empty() => (name.as_str(), std::slice::from_ref(at)),
                Item::Band { low, high, .. } => {
                    for (name, points) in [("band, low", low), ("band, high", high)] {
                        write_rows(out, &head(name), points);
                    }
                    continue;
                }
                _ => continue,
            };
            write_rows(out, &head(name), points);
        }
    }

    pub(super) fn legend(&self) -> impl Iterator<Item = &(String, Sample)> {
        self.legend.iter()
    }

    /// The places of everything that the axes have to hold.
    fn places(&self) -> (Vec<f64>, Vec<f64>) {
        let mut at: Points = Vec::new();
        let (mut levels, mut moments) = (Vec::new(), Vec::new());
        for item in &self.items {
            match item {
                Item::Line { points, .. } | Item::Room(points) => at.extend(points),
                Item::Band { low, high, .. } => at.extend(low.iter().chain(high)),
                Item::Disc { centre: (x, y), radius, .. } => {
                    at.extend([(x - radius, y - radius), (x + radius, y + radius)]);
                }
                Item::Mark { at: place, .. } | Item::Note { at: place, .. } => at.push(*place),
                Item::Level { at, .. } => levels.push(*at),
                Item::Moment { at, .. } => moments.push(*at),
            }
        }
        let xs = at.iter().map(|(x, _)| *x).chain(moments).filter_map(|x| self.x.place(x)).collect();
        let ys = at.iter().map(|(_, y)| *y).chain(levels).filter_map(|y| self.y.place(y)).collect();
        (xs, ys)
    }

    /// Where the axes would have to stand in a panel of this height, px from its left.
    pub(super) fn left_px(&self, height_px: f64) -> f64 {
        let (_, ys) = self.places();
        let span = self.y.span(ys.into_iter(), self.pad().1);
        let ticks = self.y.ticks(span, self.rows_wanted(height_px));
        let widest = ticks.labelled.iter().map(|(_, words)| width_px(words, SMALL_PX)).fold(0.0, f64::max);
        widest + 2.6 * TEXT_PX
    }

    /// The share of the ranges that is left free at their ends.
    fn pad(&self) -> (f64, f64) {
        if self.equal { (0.03, 0.03) } else { (0.0, 0.05) }
    }

    /// Px above and below the axes.
    fn margins_px(&self) -> (f64, f64) {
        (if self.title.is_empty() { 8.0 } else { 26.0 }, 3.6 * TEXT_PX)
    }

    fn rows_wanted(&self, height_px: f64) -> usize {
        let (top, bottom) = self.margins_px();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a few ticks
        let rows = ((height_px - top - bottom) / 34.0).max(2.0) as usize;
        rows
    }

    /// Draws the panel into the rectangle from `origin` of `size` (px), labels included, the axes
    /// `left` px from its left.
    pub(super) fn draw(&self, canvas: &Canvas<'_>, origin: (f64, f64), size: (f64, f64), left: f64) -> Frame {
        let (xs, ys) = self.places();
        let pad = self.pad();
        let x_span = self.x.span(xs.into_iter(), pad.0);
        let y_span = self.y.span(ys.into_iter(), pad.1);
        let (top, bottom) = self.margins_px();
        let mut frame = Frame {
            left: origin.0 + left,
            top: origin.1 + top,
            right: origin.0 + size.0 - 14.0,
            bottom: origin.1 + size.1 - bottom,
            x_span,
            y_span,
            axes: (self.x.clone(), self.y.clone()),
        };
        if self.equal {
            frame.square();
        }
        let y_ticks = self.y.ticks(frame.y_span, self.rows_wanted(size.1));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a few ticks
        let columns = ((frame.right - frame.left) / 46.0).max(2.0) as usize;
        let x_ticks = self.x.ticks(frame.x_span, columns);

        let grid = Style::solid(Colour::GRID).wide(0.8);
        let upright = |at: f64| [(frame.px_x(at), frame.top), (frame.px_x(at), frame.bottom)];
        let level = |at: f64| [(frame.left, frame.px_y(at)), (frame.right, frame.px_y(at))];
        for at in &x_ticks.fine {
            canvas.path(&upright(*at), &grid.wide(0.4));
        }
        for at in &y_ticks.fine {
            canvas.path(&level(*at), &grid.wide(0.4));
        }
        for (at, words) in &x_ticks.labelled {
            canvas.path(&upright(*at), &grid);
            let below = (frame.px_x(*at), frame.bottom + 0.9 * SMALL_PX);
            canvas.text(words, below, SMALL_PX, Align::Centre, Colour::INK);
        }
        for (at, words) in &y_ticks.labelled {
            canvas.path(&level(*at), &grid);
            let beside = (frame.left - 5.0, frame.px_y(*at));
            canvas.text(words, beside, SMALL_PX, Align::Right, Colour::INK);
        }
        // What the words beside reference lines should not cover.
        let mut lines: Vec<Points> = Vec::new();
        for item in &self.items {
            match item {
                Item::Line { points, .. } => lines.extend(frame.pieces(points)),
                Item::Level { at, .. } => {
                    let y = self.y.place(*at).map(|at| frame.px_y(at));
                    lines.extend(y.map(|y| vec![(frame.left, y), (frame.right, y)]));
                }
                _ => {}
            }
        }
        for item in &self.items {
            frame.item(canvas, item, &lines);
        }
        let (l, t, r, b) = (frame.left, frame.top, frame.right, frame.bottom);
        let rim = Style::solid(Colour::INK).wide(0.9);
        canvas.path(&[(l, t), (r, t), (r, b), (l, b), (l, t)], &rim);
        let middle = 0.5 * (l + r);
        if !self.title.is_empty() {
            canvas.text(&self.title, (middle, t - 12.0), TEXT_PX, Align::Centre, Colour::INK);
        }
        canvas.text(self.x.label(), (middle, b + 2.6 * SMALL_PX), TEXT_PX, Align::Centre, Colour::INK);
        let beside = (origin.0 + 0.8 * TEXT_PX, 0.5 * (t + b));
        canvas.text(self.y.label(), beside, TEXT_PX, Align::Upwards, Colour::INK);
        frame
    }
}

/// Where a panel's axes came to stand on the sheet, px.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    pub(crate) left: f64,
    pub(crate) top: f64,
    pub(crate) right: f64,
    pub(crate) bottom: f64,
    x_span: (f64, f64),
    y_span: (f64, f64),
    axes: (Axis, Axis),
}

impl Frame {
    fn px_x(&self, place: f64) -> f64 {
        let (low, high) = self.x_span;
        self.left + (place - low) / (high - low) * (self.right - self.left)
    }

    fn px_y(&self, place: f64) -> f64 {
        let (low, high) = self.y_span;
        self.bottom - (place - low) / (high - low) * (self.bottom - self.top)
    }

    /// Where a point is on the sheet, px; `None` where the axes have no place for it.
    pub(crate) fn px(&self, (x, y): (f64, f64)) -> Option<(f64, f64)> {
        Some((self.px_x(self.axes.0.place(x)?), self.px_y(self.axes.1.place(y)?)))
    }

    /// Px for each unit of the x axis, where that is linear.
    pub(crate) fn px_per_unit(&self) -> f64 {
        (self.right - self.left) / (self.x_span.1 - self.x_span.0)
    }

    /// Makes a unit as long on both axes by widening the one that has room.
    fn square(&mut self) {
        let (width, height) = (self.right - self.left, self.bottom - self.top);
        let per_px = ((self.x_span.1 - self.x_span.0) / width).max((self.y_span.1 - self.y_span.0) / height);
        let around = |(low, high): (f64, f64), length: f64| {
            let (middle, half) = (0.5 * (low + high), 0.5 * length * per_px);
            (middle - half, middle + half)
        };
        self.x_span = around(self.x_span, width);
        self.y_span = around(self.y_span, height);
    }

    /// The part of a stroke inside the frame (Liang and Barsky).
    fn clip(&self, a: (f64, f64), b: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let (mut from, mut to) = (0.0f64, 1.0f64);
        let edges =
            [(-dx, a.0 - self.left), (dx, self.right - a.0), (-dy, a.1 - self.top), (dy, self.bottom - a.1)];
        for (outward, room) in edges {
            if outward == 0.0 {
                if room < 0.0 {
                    return None;
                }
            } else if outward < 0.0 {
                from = from.max(room / outward);
            } else {
                to = to.min(room / outward);
            }
        }
        (from <= to).then_some(((a.0 + from * dx, a.1 + from * dy), (a.0 + to * dx, a.1 + to * dy)))
    }

    /// The pieces of a line that are inside the frame, px.
    fn pieces(&self, points: &[(f64, f64)]) -> Points2 {
        let mut pieces: Points2 = Vec::new();
        for pair in points.windows(2) {
            let (Some(a), Some(b)) = (self.px(pair[0]), self.px(pair[1])) else { continue };
            let Some((a, b)) = self.clip(a, b) else { continue };
            match pieces.last_mut() {
                Some(piece) if piece.last() == Some(&a) => piece.push(b),
                _ => pieces.push(vec![a, b]),
            }
        }
        pieces
    }

    fn holds(&self, (x, y): (f64, f64)) -> bool {
        let room = 0.5;
        (self.left - room..=self.right + room).contains(&x)
            && (self.top - room..=self.bottom + room).contains(&y)
    }

    fn item(&self, canvas: &Canvas<'_>, item: &Item, lines: &[Points]) {
        match item {
            Item::Line { points, style, .. } => {
                for piece in self.pieces(points) {
                    canvas.path(&piece, style);
                }
                if let Some(marker) = style.marker {
                    self.spaced(points, |at| canvas.mark(at, marker, style.colour, 6.0));
                }
            }
            Item::Band { low, high, colour } => {
                let around = low.iter().chain(high.iter().rev()).filter_map(|p| self.px(*p));
                let clamp =
                    |(x, y): (f64, f64)| (x.clamp(self.left, self.right), y.clamp(self.top, self.bottom));
                canvas.fill(&around.map(clamp).collect::<Vec<_>>(), *colour, 0.18);
            }
            Item::Disc { centre, radius, colour, filled } => {
                if let Some(at) = self.px(*centre) {
                    let opacity = if *filled { 0.5 } else { 0.0 };
                    canvas.disc(at, radius * self.px_per_unit(), *colour, opacity, 0.9);
                }
            }
            Item::Mark { at, marker, colour, size_px, .. } => {
                if let Some(at) = self.px(*at).filter(|at| self.holds(*at)) {
                    canvas.mark(at, *marker, *colour, *size_px);
                }
            }
            Item::Level { at, words } => {
                let Some(y) = self.axes.1.place(*at).map(|at| self.px_y(at)) else { return };
                let style = Style { dash: Dash::Dashed, ..Style::solid(Colour::FAINT).wide(1.0) };
                canvas.path(&[(self.left, y), (self.right, y)], &style);
                let half = 0.5 * width_px(words, SMALL_PX);
                let above = y - 0.75 * SMALL_PX;
                let places = [self.right - 5.0 - half, self.left + 5.0 + half].map(|x| (x, above));
                let at = freest(lines, &places, (half, 0.6 * SMALL_PX));
                canvas.text(words, at, SMALL_PX, Align::Centre, Colour::FAINT);
            }
            Item::Moment { at, words } => {
                let Some(x) = self.axes.0.place(*at).map(|at| self.px_x(at)) else { return };
                if !(self.left..=self.right).contains(&x) {
                    return;
                }
                let style = Style { dash: Dash::Dashed, ..Style::solid(Colour::FAINT).wide(1.0) };
                canvas.path(&[(x, self.top), (x, self.bottom)], &style);
                let half = 0.5 * width_px(words, SMALL_PX);
                let height = self.bottom - self.top;
                let places = [0.3, 0.45, 0.6, 0.75, 0.15, 0.9]
                    .map(|share| (x - 0.75 * SMALL_PX, self.bottom - share * height));
                let at = freest(lines, &places, (0.6 * SMALL_PX, half));
                canvas.text(words, at, SMALL_PX, Align::Upwards, Colour::FAINT);
            }
            Item::Room(_) => {}
            Item::Note { at, words } => {
                if let Some(at) = self.px(*at) {
                    canvas.text(words, at, SMALL_PX, Align::Centre, Colour::INK);
                }
            }
        }
    }

    /// Points of a line that are well apart on the sheet, so that marks do not cover it.
    fn spaced(&self, points: &[(f64, f64)], mut each: impl FnMut((f64, f64))) {
        const APART_PX: f64 = 42.0;
        let mut last: Option<(f64, f64)> = None;
        for at in points.iter().filter_map(|p| self.px(*p)).filter(|at| self.holds(*at)) {
            if last.is_none_or(|l| (at.0 - l.0).hypot(at.1 - l.1) >= APART_PX) {
                each(at);
                last = Some(at);
            }
        }
    }
}

/// The first of `places` where a box of these half sizes covers none of the lines, or else the one
/// that covers the fewest points of them.
fn freest(lines: &[Points], places: &[(f64, f64)], half: (f64, f64)) -> (f64, f64) {
    let covered = |(x, y): (f64, f64)| {
        let within = |p: (f64, f64)| (p.0 - x).abs() <= half.0 && (p.1 - y).abs() <= half.1;
        // Strokes are followed in steps of about a px.
        let strokes = lines.iter().flat_map(|line| line.windows(2));
        strokes
            .map(|ends| {
                let (a, b) = (ends[0], ends[1]);
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // lengths on a sheet
                let steps = (b.0 - a.0).hypot(b.1 - a.1).ceil().max(1.0) as u32;
                let at = |k: u32| {
                    let t = f64::from(k) / f64::from(steps);
                    (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1))
                };
                (0..=steps).filter(|k| within(at(*k))).count()
            })
            .sum::<usize>()
    };
    places.iter().copied().min_by_key(|place| covered(*place)).unwrap_or_default()
}

fn write_rows(out: &mut String, head: &str, points: &[(f64, f64)]) {
    for (x, y) in points {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{head},{x},{y}");
    }
}

/// A field of a CSV file.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

type Points2 = Vec<Vec<(f64, f64)>>;
