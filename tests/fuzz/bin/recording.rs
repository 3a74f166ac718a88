#![no_main]

// Not of the library with the other targets: their corpus is tested where there is no reader of recordings.
#[path = "../targets/recording.rs"]
mod recording;

libfuzzer_sys::fuzz_target!(|data: &[u8]| recording::recording(data));
