/// An enum whose codes cross shared memory, with its names in logs, reports and JSON. Codes are appended
/// and never change.
macro_rules! named_codes {
    (
        $(#[$outer:meta])*
        $name:ident { $($(#[$inner:meta])* $variant:ident = $code:literal, $text:literal;)+ }
    ) => {
        $(#[$outer])*
        #[repr(u32)]
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {
            $($(#[$inner])* $variant = $code,)+
        }

        impl $name {
            /// Every one, in the order of the codes.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// What a code on the wire means; `None` for codes of later versions.
            pub fn from_code(code: u32) -> Option<Self> {
                Self::ALL.iter().copied().find(|one| *one as u32 == code)
            }

            /// The name in reports, logs and JSON.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $text),+
                }
            }
        }
    };
}

pub(super) use named_codes;
