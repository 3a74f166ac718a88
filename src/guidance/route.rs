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

impl Route {
    /// The shortest ways to `goal_m` around `obstacles`. Allocates; Dijkstra over a visibility graph with
    /// eight corners for each disc and each end of a wall.
    pub fn build(obstacles: &[ObstacleView], goal_m: Vec2) -> Self {
        let mut points = Vec::new();
        for o in obstacles {
            match o.obstacle {
                Obstacle::Circle { centre_m, .. } => corners(centre_m, o.required_m(), &mut points),
                Obstacle::Segment { from_m, to_m } => {
                    corners(from_m, o.required_m(), &mut points);
                    corners(to_m, o.required_m(), &mut points);
                }
            }
        }
        points.retain(|p| obstacles.iter().all(|o| o.clearance(*p).1 >= SIGHT_ROOM_M));
        let mut nodes: Vec<Node> =
            points.into_iter().map(|position_m| Node { position_m, to_goal_m: f64::INFINITY }).collect();
        for n in &mut nodes {
            if sees(n.position_m, goal_m, SIGHT_ROOM_M, obstacles) {
                n.to_goal_m = (n.position_m - goal_m).norm();
            }
        }
        // Dijkstra over an implicit graph: small, and only at start.
        let mut done = vec![false; nodes.len()];
        loop {
            let next = (0..nodes.len())
                .filter(|&i| !done[i] && nodes[i].to_goal_m.is_finite())
                .min_by(|&a, &b| nodes[a].to_goal_m.total_cmp(&nodes[b].to_goal_m));
            let Some(i) = next else { break };
            done[i] = true;
            for k in 0..nodes.len() {
                let through = nodes[i].to_goal_m + (nodes[k].position_m - nodes[i].position_m).norm();
                if !done[k]
                    && through < nodes[k].to_goal_m
                    && sees(nodes[k].position_m, nodes[i].position_m, SIGHT_ROOM_M, obstacles)
                {
                    nodes[k].to_goal_m = through;
                }
            }
        }
        nodes.retain(|n| n.to_goal_m.is_finite());
        Self { goal_m, nodes }
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
