//! The state machine of a hybrid run: a solver works, surrogates are measured beside it, one takes over for a while, and hands back.
//!
//! A host tells what happened (its solver has made a step, with its time and its state; a stride was advanced; the state was handed back)
//! and is told what to do next ([`Action`]). The ride knows no solver: it owns the schedule, the strides beside the solver and what
//! is allowed by their errors ([`control`]), the watch over the solver's first steps after a jump, an observer's
//! rollouts, the state of a run that is carried on, and what is told of all that in tables, messages and a summary.

mod answer;
mod candidate;
mod choice;
mod conditions;
pub mod control;
mod control_settings;
mod decisions;
mod dmd;
mod dmd_settings;
#[cfg(test)]
mod dmd_tests;
mod fit_control;
mod inputs;
mod interval;
mod jump;
mod log;
mod network;
mod observe;
mod quantities;
pub mod registry;
pub mod restart;
#[allow(clippy::module_inception)]
mod ride;
mod rollouts;
mod saved;
mod schedule;
mod settings;
mod shadow;
mod start_up;
mod surrogate;
mod tables;
#[cfg(test)]
mod tests;
mod totals;
#[cfg(test)]
mod toy;
mod values;
mod watch;

pub use answer::{Action, Answer};
pub use dmd_settings::DmdSettings;
pub use log::Text;
pub use network::Network;
pub use quantities::QuantitySettings;
pub use ride::{Ahead, Host, Ride};
pub use saved::host_of;
pub use schedule::Step;
pub use settings::{Mode, RideSettings};
pub use surrogate::{Description, Growth, Resumed, Start, Surrogate};
