//! Ten lines: send robot 3 elsewhere, and print where everybody is until the daemon ends.
//!
//! ```text
//! cargo run --release -p clearway --example attach
//! ```

use clearway::attach::Client;
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let client = Client::connect("default")?;
    client.admin()?.set_goal(3, 1.5, -2.0)?;
    let mut states = client.states()?;
    while let Some(sample) = states.wait(std::time::Duration::from_secs(1))? {
        sample.present().for_each(|robot| println!("{}: ({:.2}, {:.2}) m", robot.id, robot.x_m, robot.y_m));
    }
    Ok(())
}
