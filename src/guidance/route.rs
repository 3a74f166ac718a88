//! Route around static obstacles: visibility graph of inflated obstacles, shortest-path tree rooted at the goal.
//!
//! Built when the goal or the obstacles change (allocates). Per tick `target` looks at every node once (no allocation).

use super::types::ObstacleView;
use crate::geometry::{Vec2, closest_point_on_segment, segment_distance, unit};
use crate::model::Obstacle;
use std::f64::consts::PI;

/// Corners of the polygon put around a circle or the end of a segment.
const CORNERS: u32 = 8;
/// Room the route leaves beyond the required distance.
const NODE_ROOM_M: f64 = 0.08;
const SIGHT_ROOM_M: f64 = 0.03;
/// What the robot itself needs: less, or it would lose sight of the way through a narrow gap.
const ROBOT_ROOM_M: f64 = 0.005;

#[derive(Clone, Copy, Debug)]
struct Node {
    position_m: Vec2,
    /// Route length from here to the goal; infinite when there is none.
    to_goal_m: f64,
}

/// Shortest ways to one goal for one robot radius.
#[derive(Clone, Debug)]
pub struct Route {
    goal_m: Vec2,
    nodes: Vec<Node>,
}

/// A [`Route`] on its way: among many obstacles that takes long, and can be done in parts.
#[derive(Debug)]
pub struct RouteBuilder {
    goal_m: Vec2,
    step: Step,
    nodes: Vec<Node>,
    /// Nodes whose way to the goal is the shortest.
    done: Vec<bool>,
}

/// What comes next.
#[derive(Debug, Clone, Copy)]
enum Step {
    /// The corners around an obstacle.
    Corners {
        obstacle: usize,
    },
    /// Whether a node sees the goal.
    Goal {
        node: usize,
    },
    /// The node that is nearest to the goal among those not done.
    Nearest,
    /// Whether a node's way becomes shorter through that one.
    Through {
        from: usize,
        node: usize,
    },
    Finished,
}

impl RouteBuilder {
    /// Begins a route to `goal_m`.
    pub fn new(goal_m: Vec2) -> Self {
        Self { goal_m, step: Step::Corners { obstacle: 0 }, nodes: Vec::new(), done: Vec::new() }
    }

    /// Goes on for about `looks` looks at one of `obstacles`, which are the same in each call, and takes
    /// off what it needed; whether the route is finished.
    pub fn advance(&mut self, obstacles: &[ObstacleView], looks: &mut usize) -> bool {
        while *looks > 0 {
            let needed = match self.step {
                Step::Corners { obstacle } => self.add_corners(obstacles, obstacle),
                Step::Goal { node } => self.look_at_goal(obstacles, node),
                Step::Nearest => self.take_nearest(),
                Step::Through { from, node } => self.go_through(obstacles, from, node),
                Step::Finished => return true,
            };
            *looks = looks.saturating_sub(needed);
        }
        matches!(self.step, Step::Finished)
    }

    /// The route, once it is finished; without what is not done yet before.
    pub fn finish(mut self) -> Route {
        self.nodes.retain(|n| n.to_goal_m.is_finite());
        Route { goal_m: self.goal_m, nodes: self.nodes }
    }

    fn add_corners(&mut self, obstacles: &[ObstacleView], at: usize) -> usize {
        let Some(o) = obstacles.get(at) else {
            self.done = vec![false; self.nodes.len()];
            self.step = Step::Goal { node: 0 };
            return 1;
        };
        let mut points = Vec::new();
        match o.obstacle {
            Obstacle::Circle { centre_m, .. } => corners(centre_m, o.required_m(), &mut points),
            Obstacle::Segment { from_m, to_m } => {
                corners(from_m, o.required_m(), &mut points);
                corners(to_m, o.required_m(), &mut points);
            }
        }
        let looks = points.len() * obstacles.len();
        points.retain(|p| obstacles.iter().all(|o| o.clearance(*p).1 >= SIGHT_ROOM_M));
        self.nodes.extend(points.into_iter().map(|position_m| Node { position_m, to_goal_m: f64::INFINITY }));
        self.step = Step::Corners { obstacle: at + 1 };
        looks
    }

    fn look_at_goal(&mut self, obstacles: &[ObstacleView], at: usize) -> usize {
        let Some(n) = self.nodes.get_mut(at) else {
            self.step = Step::Nearest;
            return 1;
        };
        if sees(n.position_m, self.goal_m, SIGHT_ROOM_M, obstacles) {
            n.to_goal_m = (n.position_m - self.goal_m).norm();
        }
        self.step = Step::Goal { node: at + 1 };
        obstacles.len()
    }

    /// Dijkstra over an implicit graph.
    fn take_nearest(&mut self) -> usize {
        let (nodes, done) = (&self.nodes, &self.done);
        let next = (0..nodes.len())
            .filter(|&i| !done[i] && nodes[i].to_goal_m.is_finite())
            .min_by(|&a, &b| nodes[a].to_goal_m.total_cmp(&nodes[b].to_goal_m));
        let looks = nodes.len() / 4 + 1;
        self.step = next.map_or(Step::Finished, |from| Step::Through { from, node: 0 });
        if let Some(from) = next {
            self.done[from] = true;
        }
        looks
    }

    fn go_through(&mut self, obstacles: &[ObstacleView], from: usize, at: usize) -> usize {
        let Some(n) = self.nodes.get(at) else {
            self.step = Step::Nearest;
            return 1;
        };
        self.step = Step::Through { from, node: at + 1 };
        let through = self.nodes[from].to_goal_m + (n.position_m - self.nodes[from].position_m).norm();
        if self.done[at] || through >= n.to_goal_m {
            return 1;
        }
        if sees(n.position_m, self.nodes[from].position_m, SIGHT_ROOM_M, obstacles) {
            self.nodes[at].to_goal_m = through;
        }
        obstacles.len()
    }
}

impl Route {
    /// The shortest ways to `goal_m` around `obstacles`. Allocates; Dijkstra over a visibility graph with
    /// eight corners for each disc and each end of a wall.
    pub fn build(obstacles: &[ObstacleView], goal_m: Vec2) -> Self {
        let (mut builder, mut looks) = (RouteBuilder::new(goal_m), usize::MAX);
        let finished = builder.advance(obstacles, &mut looks);
        debug_assert!(finished, "more looks than a program can take");
        builder.finish()
    }

    /// Where it leads, m.
    pub fn goal_m(&self) -> Vec2 {
        self.goal_m
    }

    /// Where to steer from `p`, and the route length left beyond that point.
    pub fn target(&self, p: Vec2, obstacles: &[ObstacleView]) -> (Vec2, f64) {
        if self.nodes.is_empty() || sees(p, self.goal_m, ROBOT_ROOM_M, obstacles) {
            return (self.goal_m, 0.0);
        }
        let mut best = (self.goal_m, 0.0);
        let mut best_length = f64::INFINITY;
        for n in &self.nodes {
            let leg = (n.position_m - p).norm();
            // A node already reached would stop the robot there.
            if leg < 0.15
                || leg + n.to_goal_m >= best_length
                || !sees(p, n.position_m, ROBOT_ROOM_M, obstacles)
            {
                continue;
            }
            best = (n.position_m, n.to_goal_m);
            best_length = leg + n.to_goal_m;
        }
        if best_length.is_finite() {
            return best;
        }
        // Pushed out of sight of everything: the nearest way counts, sliding along the obstacle leads there.
        for n in &self.nodes {
            let length = (n.position_m - p).norm() + n.to_goal_m;
            if length < best_length {
                best = (n.position_m, n.to_goal_m);
                best_length = length;
            }
        }
        best
    }
}

fn corners(centre: Vec2, keep: f64, out: &mut Vec<Vec2>) {
    let radius = (keep + NODE_ROOM_M) / libm::cos(PI / f64::from(CORNERS));
    for k in 0..CORNERS {
        out.push(centre + unit(2.0 * PI * (f64::from(k) + 0.5) / f64::from(CORNERS)) * radius);
    }
}

/// Whether the straight way keeps clear of every obstacle (never asking more than `p` itself has).
fn sees(p: Vec2, q: Vec2, room_m: f64, obstacles: &[ObstacleView]) -> bool {
    obstacles.iter().all(|o| {
        let have = o.clearance(p).1.min(o.clearance(q).1);
        let room = room_m.min(0.95 * have);
        let apart = match o.obstacle {
            Obstacle::Circle { centre_m, .. } => (closest_point_on_segment(centre_m, p, q) - centre_m).norm(),
            Obstacle::Segment { from_m, to_m } => segment_distance(p, q, from_m, to_m),
        };
        apart >= o.required_m() + room
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// However small its parts, the route is the same to the bit, and a part is never much longer than
        /// it may be.
        #[test]
        fn a_route_that_is_built_in_parts_is_the_same(
            centres in prop::collection::vec((-6.0..6.0f64, -6.0..6.0f64, 0.1..1.0f64), 0..8),
            wall in (-6.0..6.0f64, -6.0..6.0f64), part in 1..200usize, x in -8.0..8.0f64,
        ) {
            let circle = |&(x, y, radius_m)| Obstacle::Circle { centre_m: Vec2::new(x, y), radius_m };
            let mut obstacles: Vec<_> = centres.iter().map(circle).collect();
            obstacles.push(Obstacle::Segment { from_m: Vec2::new(wall.0, wall.1), to_m: Vec2::new(1.0, 2.0) });
            let views: Vec<_> =
                obstacles.into_iter().map(|obstacle| ObstacleView { obstacle, keep_m: 0.3 }).collect();
            let (whole, mut parts) = (Route::build(&views, Vec2::new(x, 1.0)), RouteBuilder::new(Vec2::new(x, 1.0)));
            let bits = |route: &Route| -> Vec<_> {
                let of = |n: &Node| [n.position_m.x, n.position_m.y, n.to_goal_m].map(f64::to_bits);
                route.nodes.iter().map(of).collect()
            };
            let mut turns = 0;
            while !parts.advance(&views, &mut part.clone()) {
                turns += 1;
                prop_assert!(turns < 1_000_000);
            }
            prop_assert!(part > 1 || turns > views.len());
            prop_assert_eq!(bits(&parts.finish()), bits(&whole));
        }
    }
}
