//! Means, fluctuations and frequencies of series, each with its uncertainty.

pub mod autoregression;
pub mod estimate;
#[cfg(test)]
mod processes;
pub mod saved;
pub mod series;
mod settling;
pub mod sine;
pub mod spectrum;
pub mod student;
pub mod table;
mod text;
pub mod transient;
pub mod watch;

pub use estimate::{Estimate, estimate};
pub use series::{Row, Series};
pub use text::with_half_width;
pub use watch::{Goal, Tolerance, Watch};
