//! Checks of trained models against recorded data.

pub mod rmse;
