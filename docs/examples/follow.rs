//! Reads along with a running daemon: the fleet's states, its commands and how its periods went.
//!
//! ```text
//! cargo run --release -p clearway --example follow -- 20            # 20 periods of the default fleet
//! ```

use clearway::attach::Client;
use clearway::wire::{StopReason, state_flags};
use std::error::Error;
use std::time::Duration;

/// No daemon has longer periods.
const PATIENCE: Duration = Duration::from_secs(5);

fn main() -> Result<(), Box<dyn Error>> {
    let periods: usize = std::env::args().nth(1).map_or(Ok(20), |text| text.parse())?;
    let client = Client::wait_for("default", PATIENCE)?;
    let (mut states, mut commands, mut telemetry) =
        (client.states()?, client.commands()?, client.telemetry()?);
    for _ in 0..periods {
        let Some(sample) = states.wait(PATIENCE)? else { return Err("the daemon has ended".into()) };
        let arrived = sample.present().filter(|robot| robot.has(state_flags::ARRIVED)).count();
        println!("tick {}: {arrived} of {} arrived", sample.header().tick, sample.present().count());
        // A sample goes back to its writer when it is dropped; four can be held at a time.
        drop(sample);

        while let Some(sample) = commands.next()? {
            let told = sample.robots().iter().filter(|command| command.stop_reason == 0).count();
            let first = sample.robots().iter().find_map(|command| StopReason::from_code(command.stop_reason));
            println!("  commands for tick {}: {told} drive, first stop {first:?}", sample.header().tick);
        }
        while let Some(sample) = telemetry.next()? {
            let slowest_ns = sample.robots().iter().map(|robot| robot.solve_ns).max().unwrap_or(0);
            let late_us = sample.header().release_lateness_ns as f64 * 1e-3;
            println!(
                "  tick {} was released {late_us:.1} µs late, solved in {slowest_ns} ns",
                sample.header().tick
            );
        }
    }
    Ok(())
}
