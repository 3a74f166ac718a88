//! Real-time, safety-critical control for fleets of wheeled robots over shared memory.
//!
//! Once a period of `T` seconds every robot `i` solves a small convex programme in its input
//! `u = (v, ω)` and the slacks `δ`:
//!
//! ```text
//! minimise    ½ uᵀ R u + w_p δ_p + w_θ δ_θ + Σ_j w_r δ_rj
//! subject to  c v + ½ T² v²            ≤ −Q_p + δ_p        arrive (FT-DCLF, position)
//!             T sin(e) ω + ½ T² H ω²   ≤ −Q_θ + δ_θ        face the reference (FT-DCLF, heading)
//!             a_j v                    ≤  b_j + δ_rj       keep a comfortable distance (DCBF)
//!             g_j v                    ≤  s_j (d_j − ρ_j)   never closer than ρ_j (DCBF, no slack)
//!             v_min ≤ v ≤ v_cap,  ω_min ≤ ω ≤ ω_max,  δ ≥ 0
//! ```
//!
//! `docs/MATH.md` derives it, proves what it guarantees and lists where it departs from the paper
//! it comes from.
//!
//! # One way through
//!
//! Data flows in one direction and each step has one module. A module uses only modules that
//! stand before it in this list:
//!
//! | step | module |
//! |---|---|
//! | exact unicycle arcs, angles, continuous-time distance | [`geometry`] |
//! | memory asked for before it is needed | [`cache`] |
//! | robots, inputs, limits, obstacles | [`model`] |
//! | the records that cross shared memory | [`wire`] |
//! | settings read so that errors name file, line and key | [`document`] |
//! | what is to be done, from a name or a file | [`scenario`] |
//! | everything that can be set | [`config`] |
//! | what disturbs robots, made and kept count of | [`disturbance`] |
//! | who is near | [`neighbours`] |
//! | where to steer and how fast, so that nobody waits for ever | [`guidance`] |
//! | Lyapunov decreases and barrier rows | [`certificate`] |
//! | the programme and its solution | [`programme`] |
//! | the exact solver and Clarabel | [`solver`] |
//! | the optimality conditions, checked | [`verify`] |
//! | solutions compared with another solver's, outside of the period | [`audit`] |
//! | all of it for the robots of one worker | [`controller`] |
//! | clearance over continuous time, arrivals, percentiles | [`figures`] |
//! | the closed loop under a virtual clock | [`evaluation`] |
//! | real and virtual time | [`clock`] |
//! | when periods start | [`schedule`] |
//! | priorities, pinning, locked memory | [`realtime`] |
//! | what a receiver of commands lets through | [`actuation`] |
//! | robots that do what the model says | [`plant`] |
//! | the channels in shared memory | [`channel`] |
//! | what an observation must be like | [`admission`] |
//! | where states come from | [`source`] |
//! | records, queues, histograms | [`telemetry`] |
//! | what a run is judged by | [`report`] |
//! | what is kept over a restart | [`journal`] |
//! | the loop, the workers and what keeps house | [`runtime`] |
//! | how other processes read along and give orders | [`attach`] |
//! | robots in a process of their own | [`robots`] |
//! | all of it with faults, by seeds | [`simulation`] |

// For `.ci/realtime-sanitizer` only: what is marked must not allocate, lock or block.
#![cfg_attr(clearway_rtsan, feature(sanitize))]

// Tests in modules and beside them share their helpers.
#[cfg(test)]
extern crate self as clearway;

pub mod actuation;
pub mod admission;
pub mod attach;
pub mod audit;
pub mod cache;
pub mod certificate;
pub mod channel;
pub mod clock;
pub mod config;
pub mod controller;
pub mod disturbance;
pub mod document;
pub mod evaluation;
pub mod figures;
pub mod geometry;
pub mod guidance;
pub mod journal;
pub mod model;
pub mod neighbours;
pub mod plant;
pub mod programme;
pub mod realtime;
pub mod report;
pub mod robots;
pub mod runtime;
pub mod scenario;
pub mod schedule;
pub mod simulation;
pub mod solver;
pub mod source;
pub mod telemetry;
pub mod verify;
pub mod wire;
