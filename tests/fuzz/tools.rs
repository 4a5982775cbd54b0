//! Fuzz targets: files that the command m4gn reads and `libm4gn.so` does not. See `../fuzzing/mod.rs`.

mod averages;
mod exchange;
mod family;
#[path = "../fuzzing/mod.rs"]
mod fuzzing;
#[path = "../samples/records.rs"]
mod records;
mod training;
