//! What every input has to leave true. Each target takes arbitrary bytes; `tests/corpus.rs` gives it the
//! inputs that are kept, libFuzzer new ones.

mod admin;
mod bytes;
mod command;
mod files;
mod journal;
mod observation;

pub use admin::admin;
pub use command::command;
pub use files::{configuration, scenario};
pub use journal::journal;
pub use observation::observation;
