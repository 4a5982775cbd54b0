//! Ranks: a communicator that may be serial, agreement on errors, and the few collectives that are used.
