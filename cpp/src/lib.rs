//! OpenFOAM case bridge.
