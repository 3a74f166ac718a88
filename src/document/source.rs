use miette::NamedSource;
use std::ops::Range;
use std::sync::Arc;

/// A text that was read: a file or a command-line override, with the name it is reported under.
pub(crate) type Source = Arc<NamedSource<String>>;

/// The name of a text that came from the command line.
pub(super) const OVERRIDE: &str = "--set";

/// Where a key or a value stands.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    /// The text it stands in.
    pub(crate) source: Source,
    /// Byte range in that text.
    pub(crate) span: Range<usize>,
}

impl Place {
    /// The place `span` of `source`, cut to the text and moved to character boundaries.
    pub(crate) fn new(source: &Source, span: Range<usize>) -> Self {
        let text = source.inner();
        let floor =
            |at: usize| (0..=at.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0);
        let start = floor(span.start);
        Self { source: Arc::clone(source), span: start..floor(span.end).max(start) }
    }

    /// Line of the first byte, counted from 1.
    pub(crate) fn line(&self) -> usize {
        1 + self.source.inner()[..self.span.start].matches('\n').count()
    }

    /// The text at this place.
    pub(crate) fn text(&self) -> &str {
        &self.source.inner()[self.span.clone()]
    }

    /// Whether it stands on the command line.
    pub(crate) fn is_override(&self) -> bool {
        self.source.name() == OVERRIDE
    }

    /// Whether both stand in the same text.
    pub(crate) fn shares_source(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.source, &other.source)
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_override() {
            return write!(f, "{OVERRIDE} {}", self.source.inner());
        }
        write!(f, "{}:{}", self.source.name(), self.line())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_count_from_one_and_spans_are_cut_to_the_text() {
        let source = Arc::new(NamedSource::new("a.toml", "x = 1\nµ = 2".to_owned()));
        assert_eq!(Place::new(&source, 0..1).to_string(), "a.toml:1");
        assert_eq!(Place::new(&source, 6..8).to_string(), "a.toml:2");
        // Inside the two bytes of `µ`, and beyond the end.
        assert_eq!(Place::new(&source, 7..7).text(), "");
        assert_eq!(Place::new(&source, 90..99).line(), 2);
    }
}
