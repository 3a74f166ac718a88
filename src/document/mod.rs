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
mod source;
mod suggest;

pub use error::{ConfigError, ErrorKind, Problem};
#[allow(unused_imports)]
pub(crate) use source::Place;
pub(crate) use suggest::nearest;
