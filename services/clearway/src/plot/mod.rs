//! Figures as SVG, in the one style of the project.
//!
//! A [`Figure`] is a grid of [`Panel`]s under one legend; a panel has two axes, linear or logarithmic,
//! and items: lines with a name, discs and marks in the plane, reference levels, bands. What belongs to
//! a control law always has that law's [`Style`], and every style differs from the others by its dashes
//! or marks as well, so that a print in grey can be read. [`Figure::svg`] gives the same bytes for the
//! same items, on every machine: no font is asked for its measures.
//!
//! ```ignore
//! use crate::plot::{Axis, Figure, Panel, Style};
//!
//! let mut panel = Panel::new(Axis::linear("time", "s"), Axis::log("solve time", "ns"));
//! panel.line("exact", vec![(0.0, 120.0), (1.0, 130.0)], Style::nth(0));
//! panel.line("Clarabel", vec![(0.0, 54e3), (1.0, 55e3)], Style::nth(1));
//! panel.level(1e6, "one millisecond");
//! let svg = Figure::new("Solve time over a run").with(panel).svg();
//! ```

mod axis;
mod canvas;
mod figure;
mod panel;
mod style;

pub(crate) use axis::Axis;
pub(crate) use figure::Figure;
pub(crate) use panel::{Frame, Panel};
pub(crate) use style::{Colour, Dash, Marker, Style};
