use ratatui::style::{Color, Modifier, Style};

/// What the terminal can show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Look {
    /// The sixteen colours.
    pub(crate) colour: bool,
    /// No character beyond ASCII.
    pub(crate) ascii: bool,
}

impl Look {
    /// Less important. Not every terminal shows the difference.
    pub(crate) const ASIDE: Style = Style::new().add_modifier(Modifier::DIM);
    /// The marked robot, the open view.
    pub(crate) const CHOSEN: Style = Style::new().add_modifier(Modifier::REVERSED);

    /// What the environment says: NO_COLOR, TERM and the locale.
    pub(crate) fn from_environment() -> Self {
        let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
        let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(set).unwrap_or_default();
        let locale = locale.to_ascii_lowercase();
        let term = set("TERM").unwrap_or_default();
        Self {
            colour: set("NO_COLOR").is_none() && term != "dumb" && !term.starts_with("vt"),
            ascii: !(locale.contains("utf-8") || locale.contains("utf8")),
        }
    }

    fn tinted(self, colour: Color, otherwise: Modifier) -> Style {
        if self.colour { Style::new().fg(colour) } else { Style::new().add_modifier(otherwise) }
    }

    /// Something is wrong.
    pub(crate) fn bad(self) -> Style {
        self.tinted(Color::Red, Modifier::REVERSED).add_modifier(Modifier::BOLD)
    }

    /// Something is to be looked at.
    pub(crate) fn warning(self) -> Style {
        self.tinted(Color::Yellow, Modifier::BOLD).add_modifier(Modifier::BOLD)
    }

    /// All is well.
    pub(crate) fn good(self) -> Style {
        self.tinted(Color::Green, Modifier::empty())
    }

    /// Where robots are to go, and what is drawn as a line.
    pub(crate) fn mark(self) -> Style {
        self.tinted(Color::Cyan, Modifier::empty())
    }

    pub(crate) fn title(self) -> Style {
        self.tinted(Color::Cyan, Modifier::empty()).add_modifier(Modifier::BOLD)
    }

    /// Heights from nothing to full.
    pub(crate) fn bars(self) -> [char; 9] {
        if self.ascii {
            [' ', '.', ':', '-', '=', '+', '*', '%', '#']
        } else {
            [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█']
        }
    }

    /// A robot that points to one of eight directions, anticlockwise from the right.
    pub(crate) fn arrows(self) -> [char; 8] {
        if self.ascii {
            ['>', '/', '^', '\\', '<', '/', 'v', '\\']
        } else {
            ['→', '↗', '↑', '↖', '←', '↙', '↓', '↘']
        }
    }

    /// One of two spellings.
    pub(crate) fn either<T>(self, unicode: T, ascii: T) -> T {
        if self.ascii { ascii } else { unicode }
    }
}
