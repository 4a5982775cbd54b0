mod elastic;
mod laplacian;
#[path = "../../tests/samples/matrices.rs"]
mod matrices;
mod pairs;
