//! Reading settings so that every complaint names the file, the line, the key and the remedy.
//!
//! A TOML text becomes a tree whose keys and values remember where they stand. [`scenario`] and
//! [`config`] read their settings from it; what they do not ask for is an unknown key. A reading
//! collects its problems and reports them together.
//!
//! Used at start-up only.
//!
//! [`scenario`]: crate::scenario
//! [`config`]: crate::config

mod error;
mod names;
mod section;
mod setting;
mod source;
mod suggest;
mod tree;

pub use error::{ConfigError, ErrorKind, Problem};
pub use names::UnknownName;
pub(crate) use names::names;
pub(crate) use section::{Found, Section};
pub(crate) use setting::{Asked, Named, quoted};
pub(crate) use source::Place;
pub(crate) use suggest::nearest;

use miette::NamedSource;
use source::Source;
use std::cell::RefCell;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

/// Largest file, bytes: ten times what the largest fleet needs.
const FILE_MAX_BYTES: usize = 4 << 20;

/// A reading notes this many problems; more are seldom read and mostly follow from the first.
const PROBLEMS_MAX: usize = 20;

/// A parsed text, the overrides on top of it, and the problems found while it is read.
pub(crate) struct Document {
    source: Source,
    table: tree::Table,
    problems: RefCell<Vec<Problem>>,
    asked: RefCell<Vec<Asked>>,
}

impl Document {
    /// The file at `path`.
    pub(crate) fn load(path: &Path) -> Result<Self, ConfigError> {
        let name = path.display().to_string();
        Self::parse(&read(path, &name)?, &name)
    }

    /// The TOML in `text`, reported under `name`.
    pub(crate) fn parse(text: &str, name: &str) -> Result<Self, ConfigError> {
        if text.len() > FILE_MAX_BYTES {
            return Err(too_large(name));
        }
        let source: Source = Arc::new(NamedSource::new(name, text.to_owned()));
        let table = tree::parse(&source)?;
        Ok(Self { source, table, problems: RefCell::default(), asked: RefCell::default() })
    }

    /// Puts one `section.key=value` on top.
    pub(crate) fn set(&mut self, argument: &str) -> Result<(), ConfigError> {
        tree::overlay(&mut self.table, tree::parse_override(argument)?);
        Ok(())
    }

    /// The top of the document.
    pub(crate) fn root(&self) -> Section<'_> {
        // An empty range at the top: a missing key has no text of its own to underline.
        Section::new(self, Some(&self.table), Place::new(&self.source, 0..0), String::new())
    }

    /// Whether the top has this key.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// Notes a problem.
    pub(crate) fn report(&self, problem: Problem) {
        let mut problems = self.problems.borrow_mut();
        if problems.len() < PROBLEMS_MAX {
            problems.push(problem);
        }
    }

    /// Whether no problem was found so far.
    pub(crate) fn is_sound(&self) -> bool {
        self.problems.borrow().is_empty()
    }

    fn asked(&self, asked: Asked) {
        self.asked.borrow_mut().push(asked);
    }

    /// Every setting with a default that was asked for, in that order.
    pub(crate) fn settings(&self) -> Vec<Asked> {
        self.asked.borrow().clone()
    }

    /// The problems in order of their lines, or `value` when there are none.
    pub(crate) fn finish<T>(self, value: Option<T>) -> Result<T, ConfigError> {
        let mut problems = self.problems.into_inner();
        problems.sort_by_key(Problem::line);
        match (ConfigError::from_problems(problems), value) {
            (Some(error), _) => Err(error),
            (None, Some(value)) => Ok(value),
            // A reader that gives up says why; this answers for one that forgot.
            (None, None) => Err(Problem::new(ErrorKind::MissingKey, "", "something is missing")
                .of(self.source.name())
                .into()),
        }
    }
}

fn read(path: &Path, name: &str) -> Result<String, ConfigError> {
    let unreadable = |why: &dyn std::fmt::Display, help: &str| {
        ConfigError::from(
            Problem::new(ErrorKind::Unreadable, "", format!("cannot be read: {why}")).of(name).advise(help),
        )
    };
    let check_path = "check the path and its permissions";
    let file = std::fs::File::open(path).map_err(|e| unreadable(&e, check_path))?;
    let mut bytes = Vec::new();
    // One byte more than allowed tells a file that is too large from one that just fits.
    file.take(FILE_MAX_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(|e| unreadable(&e, check_path))?;
    if bytes.len() > FILE_MAX_BYTES {
        return Err(too_large(name));
    }
    String::from_utf8(bytes).map_err(|e| {
        let valid = String::from_utf8_lossy(&e.as_bytes()[..e.utf8_error().valid_up_to()]);
        let line = 1 + valid.matches('\n').count();
        unreadable(&format!("line {line} is not UTF-8"), "save it as UTF-8 text")
    })
}

fn too_large(name: &str) -> ConfigError {
    let message = format!("is larger than {} MiB", FILE_MAX_BYTES >> 20);
    Problem::new(ErrorKind::TooLarge, "", message)
        .of(name)
        .advise("check that this is the right file; large fleets are split over several daemons")
        .into()
}
