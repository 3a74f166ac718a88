//! What was looked at, what it means, and what to do about it.

use serde::Serialize;

/// How a finding is to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Status {
    /// As it should be.
    Ok,
    /// Real time works, with longer delays now and then.
    Warn,
    /// It could not be looked at.
    Unknown,
    /// It prevents real-time operation.
    Fail,
}

impl Status {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warn => "warn",
            Self::Unknown => "unknown",
            Self::Fail => "fail",
        }
    }
}

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Finding {
    /// What: stable, for scripts.
    pub(crate) name: &'static str,
    /// How it is to be taken.
    pub(crate) status: Status,
    /// What was found.
    pub(crate) value: String,
    /// Why it matters; empty when it is as it should be.
    pub(crate) why: String,
    /// What to do, exactly; empty when there is nothing to do.
    pub(crate) remedy: String,
}

impl Finding {
    pub(crate) fn ok(name: &'static str, value: impl Into<String>) -> Self {
        Self { name, status: Status::Ok, value: value.into(), why: String::new(), remedy: String::new() }
    }

    pub(crate) fn warn(
        name: &'static str,
        value: impl Into<String>,
        why: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self { name, status: Status::Warn, value: value.into(), why: why.into(), remedy: remedy.into() }
    }

    pub(crate) fn fail(
        name: &'static str,
        value: impl Into<String>,
        why: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self { status: Status::Fail, ..Self::warn(name, value, why, remedy) }
    }

    pub(crate) fn unknown(name: &'static str, path: &str) -> Self {
        let remedy = format!("check that {path} is mounted and can be read by this user");
        Self {
            status: Status::Unknown,
            ..Self::warn(name, "not known", format!("{path} cannot be read"), remedy)
        }
    }
}
