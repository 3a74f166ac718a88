//! Gives a running daemon orders: pauses the fleet, sends a robot elsewhere, lets it go on.
//!
//! ```text
//! cargo run --release -p clearway --example operate -- 3 1.5 -2     # robot 3 to (1.5, -2) m
//! ```

use clearway::attach::{AdminError, Client};
use clearway::wire::AdminCode;
use std::error::Error;
use std::time::Duration;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [id, x, y] = &words[..] else { return Err("give a robot's id and its goal, x and y in m".into()) };
    let (id, x_m, y_m): (u32, f64, f64) = (id.parse()?, x.parse()?, y.parse()?);

    let client = Client::connect("default")?;
    let mut admin = client.admin()?.with_timeout(Duration::from_secs(5));
    let status = admin.status()?;
    println!("{} robots, tick {}", status.figures.robots, status.figures.tick);

    admin.pause()?;
    match admin.set_goal(id, x_m, y_m) {
        Ok(done) => println!("robot {id} obeys from tick {}", done.acts_from_tick),
        // Too many orders in one period: worth another try a little later.
        Err(error) if error.code() == Some(AdminCode::Busy) => println!("busy"),
        // It keeps the goal that it has.
        Err(AdminError::Refused { text, .. }) => println!("refused: {text}"),
        Err(error) => return Err(error.into()),
    }
    admin.resume()?;
    Ok(())
}
