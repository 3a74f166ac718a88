//! What every input has to leave true. Each target takes arbitrary bytes; `tests/corpus.rs` gives it the
//! inputs that are kept, libFuzzer new ones.

mod admin;
mod bytes;
mod command;
mod files;
mod observation;

pub use admin::admin;
pub use command::command;
pub use files::{configuration, scenario};
pub use observation::observation;
