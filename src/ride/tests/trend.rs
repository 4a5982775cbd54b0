//! Another surrogate is one file and one line of registration: the state a stride later, had it gone on as over the last stride.

use crate::registry::Making;
use crate::surrogate::{Description, Growth, Start, Surrogate};
use m4gn_base::Result;
use m4gn_state::Values;

/// Persistence with a trend.
struct Trend {
    description: Description,
    /// The measured arrays a stride before.
    before: Option<Values>,
}

pub fn make(of: &Making) -> Result<Box<dyn Surrogate>> {
    let advances = of.layout.measured();
    let description = Description {
        name: "trend".into(),
        source: "trend".into(),
        digest: "trend".into(),
        stride: 5.0 * of.start.delta_t,
        growth: vec![Growth::Unknown; advances.len()],
        reads: advances.clone(),
        advances,
        ..Description::default()
    };
    Ok(Box::new(Trend { description, before: None }))
}

impl Surrogate for Trend {
    fn describe(&self) -> &Description {
        &self.description
    }

    fn predict(&mut self, start: Start, next: &mut Values) -> Result<()> {
        let now: Values = self.description.advances.iter().map(|&i| start.state[i].clone()).collect();
        if let Some(before) = self.before.replace(now) {
            let pairs = next.iter_mut().zip(&before);
            pairs.for_each(|(n, b)| n.iter_mut().zip(b).for_each(|(n, b)| *n += *n - b));
        }
        Ok(())
    }
}
