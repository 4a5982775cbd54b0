//! Surrogates that are fitted, not trained: a run's own states at uniform times, higher-order dynamic mode decomposition of them,
//! and the state that it says of any later time, as one combination of states for all fields.

mod choose;
mod dmd;
mod driven;
#[cfg(test)]
mod driven_tests;
mod fit;
mod online;
mod outlook;
mod resume;
mod sampling;
mod settle;
mod snapshots;
mod spectrum;
mod store;
mod sums;
#[cfg(test)]
mod tests;
mod wave;

pub use fit::{FieldError, Fit, FitSettings, Model, relative};
pub use online::{OnlineDmd, Settings, State};
pub use outlook::Outlook;
pub use resume::Restored;
pub use settle::{Look, Settle, Turn};
pub use snapshots::{Combination, Snapshots};
pub use spectrum::Mode;
pub use sums::Storage;
pub use wave::Leading;
