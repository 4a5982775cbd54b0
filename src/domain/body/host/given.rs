//! What a host says before a step of a body.

use super::BodyHost;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::vector::Vector;
use m4gn_mesh::{Error, Result};

impl BodyHost {
    /// Takes the displacement of the obstacle's points at the start and at the end of the next step, m; that of the
    /// first rank counts. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for other lengths; [`Error::Numerical`] for values that are not finite.
    pub(super) fn take_obstacle(&mut self, comm: &Comm, motion: [&[Vector]; 2]) -> Result<()> {
        let checked = self.check_obstacle(motion[0], "now");
        let checked = checked.and_then(|()| self.check_obstacle(motion[1], "after the step"));
        comm.agree(checked)?;
        self.motion = Some(motion.map(|values| of_root(comm, values)));
        Ok(())
    }

    fn check_obstacle(&self, values: &[Vector], when: &str) -> Result<()> {
        let n = self.obstacle.as_ref().map_or(0, |o| o.positions.len());
        if values.len() != n {
            return Err(Error::Input(format!(
                "displacement of the obstacle {when}: expected {n} points, found {}",
                values.len()
            )));
        }
        match values.iter().position(|u| u.iter().any(|v| !v.is_finite())) {
            Some(i) => Err(Error::Numerical(format!(
                "displacement of the obstacle {when}: {:?} at point {i}",
                values[i]
            ))),
            None => self.obstacle.as_ref().map_or(Ok(()), |o| {
                let rigid = o.check_motion(values);
                rigid.map_err(|e| Error::Input(format!("displacement of the obstacle {when}: {e}")))
            }),
        }
    }

    pub(super) fn check(&self, displacement: &[Vector], when: &str) -> Result<()> {
        if displacement.len() != self.place.len() {
            return Err(Error::Input(format!(
                "displacement of the body {when}: expected {} points, found {}",
                self.place.len(),
                displacement.len()
            )));
        }
        match displacement.iter().position(|u| u.iter().any(|v| !v.is_finite())) {
            Some(i) => Err(Error::Numerical(format!(
                "displacement of the body {when}: {:?} at point {}",
                displacement[i], self.points[self.place[i]]
            ))),
            None => Ok(()),
        }
    }
}

/// The first rank's values on all ranks. Collective.
fn of_root(comm: &Comm, values: &[Vector]) -> Vec<Vector> {
    let mut flat = values.as_flattened().to_vec();
    comm.broadcast(&mut flat);
    flat.as_chunks().0.to_vec()
}
