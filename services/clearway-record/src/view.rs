//! The fleet in types that other programs draw without knowing us.
//!
//! Made from the states, at a bounded rate: nothing here is needed for a replay. World frame, metres,
//! radians; time stamps are those of the file, wall clock.

use crate::convert::State;
use crate::schema::foxglove::{
    ArrowPrimitive, Color, CylinderPrimitive, LinePrimitive, Point3, Pose, PosesInFrame, Quaternion,
    SceneEntity, SceneEntityDeletion, SceneUpdate, TextPrimitive, Vector3, line_primitive,
    scene_entity_deletion,
};
use clearway::model::Obstacle;
use clearway::wire::{RobotState, state_flags};
use prost_types::Timestamp;
use serde::Serialize;

const WORLD: &str = "world";
/// Height of a body, m: flat, so that labels and arrows stay visible from above.
const HEIGHT_M: f64 = 0.05;

/// A time of the file, ns since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct FileTime(pub(crate) u64);

impl FileTime {
    #[expect(clippy::cast_possible_wrap, reason = "below 2⁶³ until 2262, and below 10⁹")]
    fn stamp(self) -> Timestamp {
        Timestamp { seconds: (self.0 / 1_000_000_000) as i64, nanos: (self.0 % 1_000_000_000) as i32 }
    }
}

fn turned(theta_rad: f64) -> Quaternion {
    let (z, w) = (0.5 * theta_rad).sin_cos();
    Quaternion { x: 0.0, y: 0.0, z, w }
}

fn pose(x: f64, y: f64, z: f64, theta_rad: f64) -> Pose {
    Pose { position: Some(Vector3 { x, y, z }), orientation: Some(turned(theta_rad)) }
}

fn colour(r: f64, g: f64, b: f64, a: f64) -> Color {
    Color { r, g, b, a }
}

/// Blue drives, green has arrived, grey is foreign, red is not heard.
fn body_colour(robot: &RobotState) -> Color {
    if !robot.has(state_flags::VALID) {
        colour(0.85, 0.2, 0.15, 0.9)
    } else if robot.has(state_flags::FOREIGN) {
        colour(0.55, 0.55, 0.55, 0.9)
    } else if robot.has(state_flags::ARRIVED) {
        colour(0.2, 0.65, 0.3, 0.9)
    } else {
        colour(0.15, 0.4, 0.85, 0.9)
    }
}

/// The robots that there are.
pub(crate) fn present(state: &State) -> impl Iterator<Item = &RobotState> {
    state.robots.iter().filter(|robot| !robot.has(state_flags::VACANT))
}

/// All poses, in the order of the fleet.
pub(crate) fn poses(state: &State, at: FileTime) -> PosesInFrame {
    PosesInFrame {
        timestamp: Some(at.stamp()),
        frame_id: WORLD.to_owned(),
        poses: present(state).map(|r| pose(r.x_m, r.y_m, 0.0, r.theta_rad)).collect(),
    }
}

/// Bodies with their headings, and goals.
pub(crate) fn scene(state: &State, at: FileTime) -> SceneUpdate {
    let entities = present(state).flat_map(|robot| [body(robot, at), goal(robot, at)]).collect();
    SceneUpdate { deletions: Vec::new(), entities }
}

/// Everything of an earlier run is taken away, and the obstacles stand.
pub(crate) fn fresh_scene(obstacles: &[Obstacle], at: FileTime) -> SceneUpdate {
    let all = SceneEntityDeletion {
        timestamp: Some(at.stamp()),
        r#type: scene_entity_deletion::Type::All as i32,
        id: String::new(),
    };
    let entities = obstacles.iter().enumerate().map(|(index, o)| obstacle(index, o, at)).collect();
    SceneUpdate { deletions: vec![all], entities }
}

fn entity(id: String, at: FileTime) -> SceneEntity {
    SceneEntity { timestamp: Some(at.stamp()), frame_id: WORLD.to_owned(), id, ..SceneEntity::default() }
}

fn disc(x_m: f64, y_m: f64, radius_m: f64, color: Color) -> CylinderPrimitive {
    CylinderPrimitive {
        pose: Some(pose(x_m, y_m, 0.5 * HEIGHT_M, 0.0)),
        size: Some(Vector3 { x: 2.0 * radius_m, y: 2.0 * radius_m, z: HEIGHT_M }),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: Some(color),
    }
}

fn body(robot: &RobotState, at: FileTime) -> SceneEntity {
    let arrow = ArrowPrimitive {
        pose: Some(pose(robot.x_m, robot.y_m, 1.5 * HEIGHT_M, robot.theta_rad)),
        shaft_length: robot.radius_m,
        shaft_diameter: 0.2 * robot.radius_m,
        head_length: 0.5 * robot.radius_m,
        head_diameter: 0.5 * robot.radius_m,
        color: Some(colour(0.05, 0.05, 0.1, 1.0)),
    };
    let label = TextPrimitive {
        pose: Some(pose(robot.x_m, robot.y_m, 4.0 * HEIGHT_M, 0.0)),
        billboard: true,
        font_size: robot.radius_m,
        scale_invariant: false,
        color: Some(colour(0.05, 0.05, 0.1, 1.0)),
        text: robot.id.to_string(),
    };
    SceneEntity {
        cylinders: vec![disc(robot.x_m, robot.y_m, robot.radius_m, body_colour(robot))],
        arrows: vec![arrow],
        texts: vec![label],
        ..entity(format!("robot/{}", robot.id), at)
    }
}

fn goal(robot: &RobotState, at: FileTime) -> SceneEntity {
    let foreign = robot.has(state_flags::FOREIGN);
    let arm = robot.radius_m;
    let cross = [(-arm, 0.0), (arm, 0.0), (0.0, -arm), (0.0, arm)];
    let points = cross.map(|(x, y)| Point3 { x: robot.goal_x_m + x, y: robot.goal_y_m + y, z: 0.0 });
    let line = LinePrimitive {
        r#type: line_primitive::Type::LineList as i32,
        pose: Some(pose(0.0, 0.0, 0.0, 0.0)),
        thickness: 2.0,
        scale_invariant: true,
        points: points.to_vec(),
        color: Some(body_colour(robot)),
        ..LinePrimitive::default()
    };
    // A foreign robot has no goal.
    let lines = if foreign { vec![] } else { vec![line] };
    SceneEntity { lines, ..entity(format!("goal/{}", robot.id), at) }
}

fn obstacle(index: usize, obstacle: &Obstacle, at: FileTime) -> SceneEntity {
    let dark = colour(0.3, 0.3, 0.3, 1.0);
    let mut entity = entity(format!("obstacle/{index}"), at);
    match *obstacle {
        Obstacle::Circle { centre_m, radius_m } => {
            entity.cylinders.push(disc(centre_m.x, centre_m.y, radius_m, dark));
        }
        Obstacle::Segment { from_m, to_m } => entity.lines.push(LinePrimitive {
            r#type: line_primitive::Type::LineStrip as i32,
            pose: Some(pose(0.0, 0.0, 0.0, 0.0)),
            thickness: 4.0,
            scale_invariant: true,
            points: [from_m, to_m].map(|p| Point3 { x: p.x, y: p.y, z: 0.0 }).to_vec(),
            color: Some(dark),
            ..LinePrimitive::default()
        }),
    }
    entity
}

#[derive(Serialize)]
struct RosTime {
    sec: i32,
    nanosec: u32,
}

#[derive(Serialize)]
struct Header {
    stamp: RosTime,
    frame_id: String,
}

#[derive(Serialize)]
struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Serialize)]
struct PoseStamped {
    header: Header,
    position: Xyz,
    orientation: [f64; 4],
}

#[derive(Serialize)]
struct TwistStamped {
    header: Header,
    linear: Xyz,
    angular: Xyz,
}

#[expect(clippy::cast_possible_truncation, reason = "ROS counts seconds in 32 bits")]
fn ros_header(at: FileTime, frame_id: String) -> Header {
    let stamp = RosTime { sec: (at.0 / 1_000_000_000) as i32, nanosec: (at.0 % 1_000_000_000) as u32 };
    Header { stamp, frame_id }
}

/// `geometry_msgs/msg/PoseStamped` in CDR, in the world frame.
pub(crate) fn pose_stamped(robot: &RobotState, at: FileTime) -> Vec<u8> {
    let q = turned(robot.theta_rad);
    cdr(&PoseStamped {
        header: ros_header(at, WORLD.to_owned()),
        position: Xyz { x: robot.x_m, y: robot.y_m, z: 0.0 },
        orientation: [q.x, q.y, q.z, q.w],
    })
}

/// `geometry_msgs/msg/TwistStamped` in CDR: the command in force, in the robot's own frame.
pub(crate) fn twist_stamped(robot: &RobotState, at: FileTime) -> Vec<u8> {
    cdr(&TwistStamped {
        header: ros_header(at, format!("robot_{}", robot.id)),
        linear: Xyz { x: robot.v_mps, y: 0.0, z: 0.0 },
        angular: Xyz { x: 0.0, y: 0.0, z: robot.omega_radps },
    })
}

/// Little endian, with the encapsulation header that ROS 2 puts before it.
fn cdr(message: &impl Serialize) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    // Numbers and a short string into memory: this cannot fail.
    let body = cdr_encoding::to_vec_with_size_hint::<_, byteorder::LittleEndian>(message, 128);
    bytes.extend(body.unwrap_or_default());
    bytes
}
