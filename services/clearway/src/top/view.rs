//! What the operator looks at: which view, which order, where in the list.

use super::robot::{Filter, Sort};
use super::times::Measure;

/// The views, by their keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Tab {
    #[default]
    Overview,
    Robots,
    Timing,
    Attached,
}

impl Tab {
    pub(crate) const ALL: [Self; 4] = [Self::Overview, Self::Robots, Self::Timing, Self::Attached];

    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Overview => "1 overview",
            Self::Robots => "2 robots",
            Self::Timing => "3 timing",
            Self::Attached => "4 attached",
        }
    }
}

/// What keys have set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct View {
    pub(crate) tab: Tab,
    pub(crate) sort: Sort,
    pub(crate) filter: Filter,
    /// Place of the marked robot in the list.
    pub(crate) cursor: usize,
    /// First robot of the list on the screen.
    pub(crate) top: usize,
    /// How many robots the list showed last.
    pub(crate) page: usize,
    /// Which of [`Measure::ALL`] is drawn large.
    pub(crate) measure: usize,
    pub(crate) help: bool,
}

/// What a key asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Key {
    Tab(usize),
    NextTab,
    Sort,
    Filter,
    Up,
    Down,
    PageUp,
    PageDown,
    First,
    Last,
    Left,
    Right,
    Help,
    Close,
}

impl View {
    /// Does what a key asks for.
    pub(crate) fn press(&mut self, key: Key) {
        match key {
            Key::Help => self.help = !self.help,
            Key::Close => self.help = false,
            Key::Tab(index) => self.turn_to(index),
            Key::NextTab => {
                let now = Tab::ALL.iter().position(|tab| *tab == self.tab).unwrap_or(0);
                self.turn_to((now + 1) % Tab::ALL.len());
            }
            Key::Sort => (self.sort, self.cursor) = (self.sort.next(), 0),
            Key::Filter => (self.filter, self.cursor) = (self.filter.next(), 0),
            Key::Up => self.cursor = self.cursor.saturating_sub(1),
            // The list's length limits it when it is drawn.
            Key::Down => self.cursor = self.cursor.saturating_add(1),
            Key::PageUp => self.cursor = self.cursor.saturating_sub(self.page.max(1)),
            Key::PageDown => self.cursor = self.cursor.saturating_add(self.page.max(1)),
            Key::First => self.cursor = 0,
            Key::Last => self.cursor = usize::MAX,
            Key::Left => self.measure = (self.measure + Measure::ALL.len() - 1) % Measure::ALL.len(),
            Key::Right => self.measure = (self.measure + 1) % Measure::ALL.len(),
        }
    }

    fn turn_to(&mut self, index: usize) {
        if let Some(tab) = Tab::ALL.get(index) {
            (self.tab, self.help) = (*tab, false);
        }
    }

    /// Keeps the cursor in a list of `length` and on a page of `page`.
    pub(crate) fn settle(&mut self, length: usize, page: usize) {
        self.page = page;
        self.cursor = self.cursor.min(length.saturating_sub(1));
        let last_top = length.saturating_sub(page);
        let lowest = (self.cursor + 1).saturating_sub(page);
        self.top = self.top.clamp(lowest, self.cursor.max(lowest)).min(last_top);
    }
}
