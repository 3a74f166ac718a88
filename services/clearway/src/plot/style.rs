//! What things look like: colours, dashes, marks, sizes.

use clearway::config::Profile;

/// Red, green and blue, 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Colour(pub(crate) u8, pub(crate) u8, pub(crate) u8);

impl Colour {
    /// Text and frames.
    pub(crate) const INK: Self = Self(0x22, 0x22, 0x22);
    /// Reference levels and what is said beside them.
    pub(crate) const FAINT: Self = Self(0x6b, 0x6b, 0x6b);
    /// The grid.
    pub(crate) const GRID: Self = Self(0xe4, 0xe4, 0xe4);
    /// Collisions and violations, and nothing else.
    pub(crate) const ALARM: Self = Self(0xb0, 0x00, 0x20);
    /// Obstacles.
    pub(crate) const SOLID: Self = Self(0xb8, 0xb8, 0xb8);

    /// Colours that can be told apart with every kind of colour vision (Okabe and Ito's, the yellow
    /// darkened), for robots and other things that are merely many.
    const MANY: [Self; 8] = [
        Self(0x00, 0x55, 0x9e),
        Self(0xc8, 0x50, 0x00),
        Self(0x00, 0x8a, 0x66),
        Self(0xb0, 0x5a, 0x8c),
        Self(0x3c, 0x9c, 0xd4),
        Self(0xc9, 0x8a, 0x00),
        Self(0x55, 0x55, 0x55),
        Self(0x7a, 0x4a, 0xb0),
    ];

    /// The `index`-th of many; they repeat after eight.
    pub(crate) fn nth(index: usize) -> Self {
        Self::MANY[index % Self::MANY.len()]
    }

    /// As it is written in SVG.
    pub(crate) fn hex(self) -> String {
        format!("#{:02X}{:02X}{:02X}", self.0, self.1, self.2)
    }
}

/// How a line is broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dash {
    /// It is not.
    Solid,
    /// Long strokes.
    Dashed,
    /// Short strokes.
    Dotted,
}

impl Dash {
    /// Length of a stroke and of the gap after it, px.
    pub(super) fn lengths_px(self) -> Option<(f64, f64)> {
        match self {
            Self::Solid => None,
            Self::Dashed => Some((9.0, 4.0)),
            Self::Dotted => Some((2.5, 3.0)),
        }
    }
}

/// A mark on a line or on its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Marker {
    /// A filled disc.
    Disc,
    /// A ring.
    Ring,
    /// A filled square.
    Square,
    /// A filled triangle.
    #[allow(dead_code, reason = "the style is whole before every part of it has a user")]
    Triangle,
    /// A filled square on its corner.
    Diamond,
    /// Two crossing strokes.
    Cross,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Style {
    /// Its colour.
    pub(crate) colour: Colour,
    /// Its dashes.
    pub(crate) dash: Dash,
    /// A mark now and then along it.
    pub(crate) marker: Option<Marker>,
    /// Its width, px.
    pub(crate) width_px: f64,
}

impl Style {
    /// A solid line of the usual width.
    pub(crate) fn solid(colour: Colour) -> Self {
        Self { colour, dash: Dash::Solid, marker: None, width_px: 1.8 }
    }

    /// The style of a control law, the same in every figure. From dark to light in grey, too.
    pub(crate) fn of(profile: Profile) -> Self {
        match profile {
            Profile::Certified => Self::solid(Colour(0x00, 0x4f, 0x98)),
            Profile::Exponential => Self { dash: Dash::Dashed, ..Self::solid(Colour(0xd0, 0x5a, 0x00)) },
            Profile::Paper => Self { dash: Dash::Dotted, ..Self::solid(Colour(0x8c, 0x8c, 0x8c)) },
        }
    }

    /// The `index`-th of several lines: colour, dashes and marks differ together.
    #[allow(dead_code, reason = "the style is whole before every part of it has a user")]
    pub(crate) fn nth(index: usize) -> Self {
        const DASHES: [Dash; 3] = [Dash::Solid, Dash::Dashed, Dash::Dotted];
        const MARKS: [Marker; 5] =
            [Marker::Disc, Marker::Square, Marker::Triangle, Marker::Diamond, Marker::Ring];
        Self {
            dash: DASHES[index % DASHES.len()],
            marker: Some(MARKS[index % MARKS.len()]),
            ..Self::solid(Colour::nth(index))
        }
    }

    /// The same with a mark now and then.
    #[allow(dead_code, reason = "the style is whole before every part of it has a user")]
    pub(crate) fn marked(self, marker: Marker) -> Self {
        Self { marker: Some(marker), ..self }
    }

    /// The same without marks.
    #[allow(dead_code, reason = "the style is whole before every part of it has a user")]
    pub(crate) fn unmarked(self) -> Self {
        Self { marker: None, ..self }
    }

    /// The same at another width.
    pub(crate) fn wide(self, width_px: f64) -> Self {
        Self { width_px, ..self }
    }
}

/// Fonts that are where the reader is; none is needed to draw.
pub(super) const FONTS: &str = "Helvetica Neue, Helvetica, Arial, Liberation Sans, DejaVu Sans, sans-serif";

/// Size of tick labels and notes, px.
pub(super) const SMALL_PX: f64 = 11.0;

/// Size of axis labels, legends and titles of panels, px.
pub(super) const TEXT_PX: f64 = 12.5;

/// A generous guess at the width of a text of `size_px`, px.
pub(super) fn width_px(text: &str, size_px: f64) -> f64 {
    text.chars().map(|c| if "il.,:;|()' ".contains(c) { 0.34 } else { 0.58 }).sum::<f64>() * size_px
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(c: Colour) -> f64 {
        0.299 * f64::from(c.0) + 0.587 * f64::from(c.1) + 0.114 * f64::from(c.2)
    }

    #[test]
    fn the_laws_differ_in_grey_and_in_their_dashes() {
        let styles = [Profile::Certified, Profile::Exponential, Profile::Paper].map(Style::of);
        for (i, a) in styles.iter().enumerate() {
            for b in &styles[..i] {
                assert!((grey(a.colour) - grey(b.colour)).abs() > 20.0, "{a:?} {b:?}");
                assert_ne!(a.dash, b.dash);
            }
        }
    }

    #[test]
    fn neighbouring_lines_differ_in_three_ways() {
        for i in 0..7 {
            let (a, b) = (Style::nth(i), Style::nth(i + 1));
            assert!(a.colour != b.colour && a.dash != b.dash && a.marker != b.marker);
        }
    }
}
