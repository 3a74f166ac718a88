use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use clearway::geometry::TimedArc;
use clearway::model::RobotId;
use clearway::robots::MotionRecord;
use miette::{IntoDiagnostic, WrapErr};

/// Writes what the robots did, one arc a line.
pub(crate) struct Trajectory {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Trajectory {
    pub(crate) fn create(path: &Path) -> miette::Result<Self> {
        let file = File::create(path)
            .into_diagnostic()
            .wrap_err_with(|| format!("the trajectory {} cannot be written", path.display()))?;
        Ok(Self { path: path.to_owned(), file: BufWriter::new(file) })
    }

    /// Adds the motions of each robot, and sees that the file has them: this process may be killed.
    pub(crate) fn write(&mut self, ids: &[RobotId], motions: &[Vec<TimedArc>]) -> miette::Result<()> {
        let mut write = || -> std::io::Result<()> {
            for (id, motions) in ids.iter().zip(motions) {
                for motion in joined(motions) {
                    serde_json::to_writer(&mut self.file, &MotionRecord::new(*id, &motion))?;
                    self.file.write_all(b"\n")?;
                }
            }
            self.file.flush()
        };
        let written = write().into_diagnostic();
        written.wrap_err_with(|| format!("the trajectory {} cannot be written", self.path.display()))
    }
}

/// The motions with those put together that go on alike.
fn joined(motions: &[TimedArc]) -> Vec<TimedArc> {
    let mut joined: Vec<TimedArc> = Vec::with_capacity(motions.len());
    for motion in motions {
        let input = |m: &TimedArc| (m.arc.v_mps, m.arc.omega_radps);
        match joined.last_mut().filter(|last| last.to_ns == motion.from_ns && input(last) == input(motion)) {
            Some(last) => last.to_ns = motion.to_ns,
            None => joined.push(*motion),
        }
    }
    joined
}
