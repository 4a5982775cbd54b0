//! Files of version 2, which held bodies at points alone: the same arrays as now at other places, and one field, the
//! displacement. What they hold beside (matrices, stresses, edges) is not read.

use super::schema::FieldMeta;

/// The version this is about.
pub(super) const VERSION: u32 = 2;

/// Where the points of a body at rest and their types lie in a file of this version.
pub(super) fn points(version: u32) -> [&'static str; 2] {
    match version {
        VERSION => ["points/positions", "points/type"],
        _ => ["mesh/cell_centres", "mesh/point_type"],
    }
}

/// Where the values of a field at the cells, or at the points of a body, lie in a file of this version.
pub(super) fn values(version: u32, field: &str) -> String {
    match version {
        VERSION => "displacement".into(),
        _ => format!("fields/{field}/cells"),
    }
}

/// The one field of version 2.
pub(super) fn displacement() -> FieldMeta {
    FieldMeta {
        name: "D".into(),
        vector: true,
        dimensions: [0, 1, 0, 0, 0, 0, 0],
    }
}
