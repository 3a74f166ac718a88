use crate::wire::{AdminCode, AdminKind, AdminRequest, NO_ROBOT};

/// A request may expire at most this far ahead, ns.
const EXPIRY_MAX_NS: u64 = 60_000_000_000;

/// Why a request is not carried out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// What the answer says.
    pub code: AdminCode,
    /// Id of the robot that it is about, or [`NO_ROBOT`].
    pub robot: u32,
    /// The reason in words, with what to change.
    pub text: String,
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

    pub(super) fn about_no_robot() -> Self {
        Self::malformed("this request is about no robot")
    }
}

/// Whether a request is to be looked at at all, at `now_ns` by the run `epoch`; what it asks for.
pub(super) fn check_header(header: &AdminRequest, epoch: u64, now_ns: u64) -> Result<AdminKind, Refusal> {
    if now_ns >= header.expires_ns {
        return Err(expired());
    }
    if header.expires_ns - now_ns > EXPIRY_MAX_NS {
        return Err(Refusal::malformed("a request has to expire within a minute"));
    }
    if header.epoch != 0 && header.epoch != epoch {
        let text = format!("another run is meant: this one has the epoch {epoch}");
        return Err(Refusal::fleet(AdminCode::OtherEpoch, text));
    }
    let kind = AdminKind::from_code(header.kind);
    kind.ok_or_else(|| Refusal::malformed(&format!("there is no request of kind {}", header.kind)))
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

pub(super) fn outdated() -> Refusal {
    Refusal::fleet(AdminCode::Busy, "the fleet changed meanwhile: try again".to_owned())
}
