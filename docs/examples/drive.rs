//! A fleet outside of the daemon: obeys the commands and says where it is.
//!
//! Stands in for drivers and a localisation system. The daemon has to listen to observations:
//!
//! ```text
//! clearwayd --config docs/examples/clearway.toml --set source.kind=observation --scenario swap8 &
//! cargo run --release -p clearway --example drive -- 10             # 10 s of swap8
//! ```

use clearway::attach::Client;
use clearway::clock::{Clock, MonotonicClock};
use clearway::plant::Plant;
use clearway::scenario::Scenario;
use std::error::Error;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let seconds: f64 = std::env::args().nth(1).map_or(Ok(10.0), |text| text.parse())?;
    let client = Client::wait_for("default", Duration::from_secs(5))?;
    // Which robots there are, and where they start, is what the daemon says.
    let scenario = Scenario::parse(&client.admin()?.scenario()?, "the daemon's scenario")?;
    let period_ns = client.admin()?.status()?.figures.period_ns;
    let mut commands = client.commands()?;
    let mut observations = client.observations(scenario.robots.len())?;

    // Robots that move exactly as the model says, each behind the gate that every receiver of commands
    // has to have: nothing acts before its time, twice, or after it has expired, and nothing that moves
    // after a command that was missed.
    let mut plant = Plant::new(&scenario, period_ns, MonotonicClock.now_ns());
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    while Instant::now() < end {
        let now_ns = MonotonicClock.now_ns();
        plant.advance(now_ns);
        while let Some(sample) = commands.next()? {
            for (index, command) in sample.robots().iter().enumerate() {
                // A command that is refused leaves the robot standing.
                let _ = plant.command(index, sample.header(), command, now_ns);
            }
        }
        // With each pose goes what the robot's gate holds: the daemon then knows of one that missed a command.
        let robots = scenario.robots.iter().zip(plant.poses()).enumerate();
        let seen: Vec<_> =
            robots.map(|(index, (robot, pose))| (robot.id, pose, plant.holding(index))).collect();
        observations.report(now_ns, &seen)?;
        // Often enough for commands that come out only at the deadline: late ones are missed.
        std::thread::sleep(Duration::from_nanos(period_ns / 10).min(Duration::from_millis(1)));
    }
    for (robot, pose) in scenario.robots.iter().zip(plant.poses()) {
        let left_m = (robot.goal_m - pose.position_m).norm();
        println!("robot {}: {left_m:.3} m from its goal", robot.id);
    }
    Ok(())
}
