//! Pictures of one rollout on the cells of a flow: the recorded headline field, the predicted one and their difference at some steps.

use super::{Case, Prediction};
use m4gn_base::Result;
use m4gn_data::Trajectory;
use m4gn_report::{CellMap, FieldPicture, Snapshot, snapshot};

/// Width of one panel, pixels.
const PANEL: usize = 520;

/// The states that were kept; None where there is nothing to see: of bodies, which ParaView shows, and of cells in space.
///
/// # Errors
/// When the trajectory cannot be read again.
pub(super) fn picture(case: &Case, rollout: &Prediction) -> Result<Option<FieldPicture>> {
    let trajectory = Trajectory::open(&case.path)?;
    let Some(map) = trajectory.cells().ok().and_then(|mesh| CellMap::from_mesh(mesh, PANEL)) else {
        return Ok(None);
    };
    let (field, unit) = &case.fields[0];
    let width = if trajectory.field(field)?.vector { 3 } else { 1 };
    let rows = rollout.kept.iter().map(|(&step, found)| {
        let truth = super::scene::recorded(&trajectory, field, step * case.pace.frames)?;
        Ok(Snapshot::new(case.times[step - 1], &truth, found, width))
    });
    let rows: Vec<Snapshot> = rows.collect::<Result<_>>()?;
    Ok(Some(snapshot::picture(map, ["solver", "model"], [field, unit], &rows)))
}
