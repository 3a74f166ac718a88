use crate::wire::{AdminCode, NO_ROBOT};

/// Why a request is not carried out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Refusal {
    pub(super) code: AdminCode,
    /// Id of the robot that it is about, or [`NO_ROBOT`].
    pub(super) robot: u32,
    /// The reason in words, with what to change.
    pub(super) text: String,
}

impl Refusal {
    pub(super) fn of(robot: u32, code: AdminCode, text: String) -> Self {
        Self { code, robot, text }
    }

    pub(super) fn fleet(code: AdminCode, text: String) -> Self {
        Self::of(NO_ROBOT, code, text)
    }

    pub(super) fn malformed(text: &str) -> Self {
        Self::fleet(AdminCode::Malformed, text.to_owned())
    }
}

pub(super) fn busy(text: &str) -> Refusal {
    Refusal::fleet(AdminCode::Busy, format!("{text}: try again after a period"))
}

pub(super) fn expired() -> Refusal {
    Refusal::fleet(AdminCode::Expired, "the request had expired before it could be carried out".to_owned())
}

pub(super) fn ending() -> Refusal {
    Refusal::fleet(AdminCode::Ending, "the run is ending".to_owned())
}
