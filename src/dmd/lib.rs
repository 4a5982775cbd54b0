//! Surrogates that are fitted, not trained: a run's own states at uniform times, higher-order dynamic mode decomposition of them,
//! and the state that it says of any later time, as one combination of states for all fields.

mod choose;
mod dmd;
mod online;
mod sampling;
mod settle;
mod snapshots;
mod spectrum;
mod store;
#[cfg(test)]
mod tests;
mod wave;

pub use choose::{FieldError, Fit, FitSettings, relative};
pub use dmd::{Delayed, Dmd, Shape, Window};
pub use online::{OnlineDmd, Outlook, Restored, Settings, State};
pub use settle::{Look, Settle, Turn};
pub use snapshots::{Combination, Snapshots, Storage};
pub use spectrum::Mode;
pub use wave::Leading;
