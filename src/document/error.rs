use super::source::Place;
use miette::{Diagnostic, LabeledSpan, SourceCode};
use std::fmt::{self, Write as _};

/// What is wrong, for programs that react to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// The file cannot be read, or is not UTF-8.
    Unreadable,
    /// The file, the fleet or a list is larger than what is accepted.
    TooLarge,
    /// Not TOML.
    Syntax,
    /// A key that has no meaning here.
    UnknownKey,
    /// A key that has to be there is not.
    MissingKey,
    /// The value has another type than the key asks for.
    WrongType,
    /// A number outside the range of its key, or not finite.
    OutOfRange,
    /// A name that is not in its list: a choice, a built-in scenario.
    UnknownName,
    /// Two values that are fine alone exclude each other.
    Contradiction,
}

/// Why a scenario or a configuration was refused: one problem, or several found in one reading.
///
/// Its `Display` is one line, `file:line: key: what is wrong`. As a [`miette::Diagnostic`] it
/// carries the source with labels, and what to change as help; the problems after the first are
/// its related diagnostics.
#[derive(Debug, Clone)]
pub struct ConfigError {
    first: Box<Problem>,
    others: Vec<Problem>,
}

impl ConfigError {
    /// The error made of `problems`; `None` when there are none.
    pub(crate) fn from_problems(mut problems: Vec<Problem>) -> Option<Self> {
        if problems.is_empty() {
            return None;
        }
        let first = Box::new(problems.remove(0));
        Some(Self { first, others: problems })
    }

    /// All problems found, at least one.
    pub fn problems(&self) -> impl Iterator<Item = &Problem> {
        std::iter::once(self.first.as_ref()).chain(&self.others)
    }

    /// The first problem.
    pub fn first(&self) -> &Problem {
        &self.first
    }

    /// What is wrong in the first problem.
    pub fn kind(&self) -> ErrorKind {
        self.first.kind
    }
}

impl From<Problem> for ConfigError {
    fn from(problem: Problem) -> Self {
        Self { first: Box::new(problem), others: Vec::new() }
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.first.fmt(f)?;
        match self.others.len() {
            0 => Ok(()),
            1 => f.write_str(" (and one more problem)"),
            n => write!(f, " (and {n} more problems)"),
        }
    }
}

impl std::error::Error for ConfigError {}

impl Diagnostic for ConfigError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.first.help()
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.first.source_code()
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        self.first.labels()
    }

    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn Diagnostic> + 'a>> {
        Some(Box::new(self.others.iter().map(|p| p as &dyn Diagnostic)))
    }
}

/// One thing that is wrong, where, and what to change.
#[derive(Debug, Clone)]
pub struct Problem {
    kind: ErrorKind,
    /// File or scenario that has no text to point into.
    subject: String,
    key: String,
    message: String,
    help: String,
    places: Vec<(Place, String)>,
}

impl Problem {
    /// A problem of `key` (empty: of the whole), without a place so far.
    pub(crate) fn new(kind: ErrorKind, key: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            kind,
            subject: String::new(),
            key: one_line(&key.into()),
            message: one_line(&message.into()),
            help: String::new(),
            places: Vec::new(),
        }
    }

    /// What to change.
    pub(crate) fn advise(mut self, help: impl Into<String>) -> Self {
        self.help = help.into();
        self
    }

    /// What has the problem, when there is no text to point into.
    pub(crate) fn of(mut self, subject: impl Into<String>) -> Self {
        self.subject = subject.into();
        self
    }

    /// The same problem, found while `key` was looked up.
    pub(crate) fn under(mut self, key: impl Into<String>) -> Self {
        self.key = key.into();
        self
    }

    /// Points at a place; the first place is where the problem is reported.
    pub(crate) fn at(mut self, place: &Place, label: impl Into<String>) -> Self {
        self.places.push((place.clone(), label.into()));
        self
    }

    /// What is wrong, for programs.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// The key with its path, for instance `robot[2].start.x_m`; empty when it is about the whole.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// The line it is reported at, from 1; `None` when there is no text to point into.
    pub fn line(&self) -> Option<usize> {
        self.places.first().map(|(place, _)| place.line())
    }

    /// What is wrong, without file, line and key.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// Places in other texts than the first: a diagnostic shows one source, so these go in words.
    fn elsewhere(&self) -> impl Iterator<Item = &(Place, String)> {
        self.places.iter().filter(|(place, _)| !place.shares_source(&self.places[0].0))
    }
}

/// Most characters of a message: it may quote what stands in the file.
const LINE_MAX: usize = 300;

/// One line without control characters, whatever the file contains.
fn one_line(text: &str) -> String {
    let escaped = text.chars().flat_map(|c| {
        let (plain, escaped) =
            if c.is_control() { (None, Some(c.escape_default())) } else { (Some(c), None) };
        plain.into_iter().chain(escaped.into_iter().flatten())
    });
    let mut line: String = escaped.take(LINE_MAX).collect();
    if line.chars().count() == LINE_MAX {
        line.push('…');
    }
    line
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.places.first() {
            Some((place, _)) => write!(f, "{place}: ")?,
            None if !self.subject.is_empty() => write!(f, "{}: ", self.subject)?,
            None => {}
        }
        if !self.key.is_empty() {
            write!(f, "{}: ", self.key)?;
        }
        f.write_str(&self.message)
    }
}

impl std::error::Error for Problem {}

impl Diagnostic for Problem {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        let mut text = self.help.clone();
        for (place, label) in self.elsewhere() {
            let gap = if text.is_empty() { "" } else { "\n" };
            // Writing to a string cannot fail.
            let _ = write!(text, "{gap}{place}: {label}: {}", place.text());
        }
        if text.is_empty() { None } else { Some(Box::new(text)) }
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.places.first().map(|(place, _)| place.source.as_ref() as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let (first, _) = self.places.first()?;
        let here = self.places.iter().filter(|(place, _)| place.shares_source(first));
        Some(Box::new(
            here.map(|(place, label)| LabeledSpan::new_with_span(Some(label.clone()), place.span.clone())),
        ))
    }
}
