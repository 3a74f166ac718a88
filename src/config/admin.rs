/// What operators may do while the daemon runs, and how much of it at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AdminConfig {
    /// Robots that the fleet has room for; fewer than the scenario has: as many as that.
    pub capacity: usize,
    /// Clients that `admin` can have at a time.
    pub max_clients: usize,
    /// Goals, additions and removals that are carried out in one period, and as many pauses, resumes and
    /// clears; what goes beyond is answered busy.
    pub changes_per_period: usize,
}

impl Default for AdminConfig {
    fn default() -> Self {
        Self { capacity: 0, max_clients: 16, changes_per_period: 8 }
    }
}
