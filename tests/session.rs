//! Sessions of models on meshes: their bits, and other numberings.

mod fixed_outputs;
mod renumber;
