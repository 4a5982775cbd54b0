//! Values of the advanced fields on this rank, and what they have in all.

use crate::surrogate::Advanced;
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_step::{Field, FieldMut};

/// The cell values of each advanced field.
pub(crate) type Values = Vec<Vec<f64>>;

/// What a host hands over: fields by name, and of each, where it knows, which boundary faces hold their value; those of other faces follow
/// their cell's.
#[derive(Clone, Copy, Debug, Default)]
pub struct Given<'a> {
    /// Of all surrogates, what they read and what they advance.
    pub fields: &'a [Field<'a>],
    /// As many as the fields, or none: every face holds its value. `[n_boundary]`, not 0: it is held.
    pub held: &'a [Option<&'a [i32]>],
    /// The cell of each boundary face.
    pub owners: &'a [i32],
}

impl Given<'_> {
    /// Copies the advanced fields out of those that were given. Collective; all ranks fail together.
    pub(crate) fn values(&self, comm: &Comm, advanced: &[Advanced]) -> Result<Values> {
        let one = |a: &Advanced| self.field(a).map(|field| field.cells.to_vec());
        comm.agree(advanced.iter().map(one).collect())
    }

    fn field(&self, advanced: &Advanced) -> Result<&Field<'_>> {
        let Advanced { name, components, .. } = advanced;
        let found = self.fields.iter().find(|f| f.name == name);
        match found {
            Some(field) if field.components == *components => Ok(field),
            Some(field) => Err(Error::Input(format!(
                "field '{name}': expected {components} components, found {}",
                field.components
            ))),
            None => Err(Error::Input(format!("field '{name}' is missing, which the surrogate advances"))),
        }
    }
}

/// The values as a surrogate takes and leaves them.
pub(crate) fn places<'a>(advanced: &'a [Advanced], values: &'a mut Values) -> Vec<FieldMut<'a>> {
    let pairs = advanced.iter().zip(values.iter_mut());
    pairs.map(|(a, cells)| FieldMut { name: &a.name, components: a.components, cells }).collect()
}

/// From old (0) to now (1).
pub(crate) fn between(old: f64, now: f64, fraction: f64) -> f64 {
    old + fraction * (now - old)
}

/// Root mean squares over the rows of all ranks and the solved components, of fields' values one after the other. Collective.
pub(crate) fn rms<I: Iterator<Item = f64>>(
    comm: &Comm,
    advanced: &[Advanced],
    values: impl Iterator<Item = I>,
) -> Vec<f64> {
    let (mut sums, mut rows) = (Vec::new(), Vec::new());
    for (field, list) in advanced.iter().zip(values) {
        let (mut sum, mut n) = (0.0, 0i64);
        for value in list {
            sum += value * value;
            n += 1;
        }
        sums.push(sum);
        rows.push(n / field.components as i64);
    }
    comm.sum_f64(&mut sums);
    comm.sum_i64(&mut rows);
    let pairs = advanced.iter().zip(sums).zip(rows);
    let mean =
        |((field, sum), n): ((&Advanced, f64), i64)| (sum / (field.solved as i64 * n.max(1)) as f64).sqrt();
    pairs.map(mean).collect()
}

/// The level about which a field varies: its mean over the rows of all ranks, where it is a scalar; 0 of a vector. Collective.
pub(crate) fn levels(comm: &Comm, advanced: &[Advanced], values: &Values) -> Vec<f64> {
    let mut sums: Vec<f64> = values.iter().map(|v| v.iter().sum()).collect();
    let mut rows: Vec<i64> = values.iter().map(|v| v.len() as i64).collect();
    comm.sum_f64(&mut sums);
    comm.sum_i64(&mut rows);
    let pairs = advanced.iter().zip(sums).zip(rows);
    let level = |((field, sum), n): ((&Advanced, f64), i64)| match field.components {
        1 => sum / n.max(1) as f64,
        _ => 0.0,
    };
    pairs.map(level).collect()
}
