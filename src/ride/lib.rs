//! The state machine of a hybrid run: a solver works, surrogates are measured beside it, one takes over for a while, and hands back.
//!
//! A host tells what happened (its solver has made a step, with its time and its fields; a stride was advanced; the state was handed back)
//! and is told what to do next ([`Action`]). The ride knows no solver: it owns the schedule, the strides beside the solver and what
//! is allowed by their errors ([`control`]), the watch over the solver's first steps after a jump, what surrogates learn, an observer's
//! rollouts, the state of a run that is carried on, and what is told of all that in tables, messages and a summary.

mod arrays;
mod choice;
pub mod control;
mod dmd_settings;
mod jump;
mod linear;
#[cfg(test)]
mod linear_tests;
mod log;
mod network;
mod observe;
mod quantities;
pub mod restart;
#[allow(clippy::module_inception)]
mod ride;
mod rider;
mod schedule;
mod settings;
mod shadow;
mod state;
mod surrogate;
mod tables;
#[cfg(test)]
mod tests;
mod totals;
#[cfg(test)]
mod toy;
mod values;
mod watch;

pub use dmd_settings::DmdSettings;
pub use linear::Fitted;
pub use log::Text;
pub use network::Network;
pub use quantities::QuantitySettings;
pub use ride::{Action, Answer, Ride};
pub use schedule::Step;
pub use settings::{AdaptEntries, Kind, Mode, RideSettings};
pub use state::host_of;
pub use surrogate::{Advanced, Lesson, Surrogate};
pub use values::Given;
