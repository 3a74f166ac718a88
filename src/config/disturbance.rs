use crate::document::names;
use crate::model::Disturbance;

/// How the plant spends the disturbance that it is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pattern {
    /// Independent and uniform up to the amplitude, from the seed.
    #[default]
    Random,
    /// At the amplitude all the time, in the sense that brings every robot closer to its nearest
    /// neighbour: worse than chance.
    Adversarial,
}

names!(Pattern { Random => "random", Adversarial => "adversarial" });

/// What the plant does to the robots. What the safety rows allow for is set apart from it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DisturbanceConfig {
    /// Random or the worst.
    pub pattern: Pattern,
    /// Every number gives another run, always the same one.
    pub seed: u64,
    /// Largest disturbance.
    pub amplitude: Disturbance,
}
