//! The kinds of surrogates that a ride makes by name. A network is the host's own: it hands one in.

use crate::dmd;
use crate::schedule::Step;
use crate::settings::RideSettings;
use crate::surrogate::Surrogate;
use m4gn_base::Result;
use m4gn_parallel::Comm;
use m4gn_state::Layout;
use std::sync::Arc;

/// What a surrogate is made of.
pub struct Making<'a> {
    /// The ranks.
    pub comm: &'a Comm,
    /// The arrays of the state.
    pub layout: &'a Arc<Layout>,
    /// What the case sets.
    pub settings: &'a RideSettings,
    /// Where the run begins.
    pub start: &'a Step,
}

/// Makes a surrogate. Collective; all ranks fail together.
type Make = fn(&Making) -> Result<Box<dyn Surrogate>>;

/// Each kind by its name in the setting `surrogates`.
pub const KINDS: &[(&str, Make)] = &[
    ("dmd", dmd::make),
    #[cfg(test)]
    ("trend", crate::tests::trend::make),
];

/// The name of the surrogate that the host hands in.
pub const NETWORK: &str = "network";

/// How a kind is made.
pub(crate) fn find(name: &str) -> Option<Make> {
    KINDS.iter().find(|(kind, _)| *kind == name).map(|(_, make)| *make)
}
