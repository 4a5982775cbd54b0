//! The command m4gn from outside, the book, and the rooms of the tree: one program, as linking a test takes longer than compiling it.

mod architecture;
mod bench;
mod book;
mod cli;
mod common;
mod compare;
mod convert;
mod generate;
mod hybrid;
mod program;
mod segment;
mod study;
mod train;
mod tree;
