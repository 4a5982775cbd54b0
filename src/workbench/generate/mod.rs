//! Making training data: random cases of a family.
//!
//! [`queue`] runs many at once, whatever they are; [`process`] runs their programs. A [`family`] of OpenFOAM cases is a folder
//! of data: [`parameter`] draws what it says, [`expression`] computes what follows, [`case`] writes and runs the case with its [`command`]s, and m4gnRecorder
//! records. With FElupe, [`solids`] asks the Python package in `tools/`, which draws, simulates and records.

pub mod case;
pub mod command;
pub mod expression;
pub mod family;
mod guard;
pub mod openfoam;
pub mod parameter;
pub mod process;
pub mod queue;
pub mod requirement;
mod shipped;
pub mod solids;

use m4gn_data::Split;

/// Split of case `index` among `count`: of ten in a row the ninth is for validation and the tenth for test.
///
/// The split of a case does not change when the data set grows; only data sets of three to nine have their last two
/// cases for validation and test instead, since they would have none.
pub fn automatic_split(index: u64, count: u64) -> Split {
    let (valid, test) = match count {
        0..=2 => return Split::Train,
        3..=9 => (index + 2 == count, index + 1 == count),
        _ => (index % 10 == 8, index % 10 == 9),
    };
    match (valid, test) {
        (true, _) => Split::Valid,
        (_, true) => Split::Test,
        _ => Split::Train,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splits_are_80_10_10_with_one_of_each() {
        let tally = |count: u64| {
            let of = |s: Split| (0..count).filter(|&i| automatic_split(i, count) == s).count();
            (of(Split::Train), of(Split::Valid), of(Split::Test))
        };
        assert_eq!(tally(100), (80, 10, 10));
        assert_eq!(tally(10), (8, 1, 1));
        assert_eq!(tally(3), (1, 1, 1));
        assert_eq!(tally(7), (5, 1, 1));
        assert_eq!(tally(1), (1, 0, 0));
        assert!((0..100).all(|i| automatic_split(i, 100) == automatic_split(i, 40) || i >= 40));
    }
}
