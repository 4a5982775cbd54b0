//! The bridge to OpenFOAM in the tests' own process, apart from those of the command.

mod common;
mod foam_case;
mod foam_solid;
