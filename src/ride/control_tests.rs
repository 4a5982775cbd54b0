use super::*;
use m4gn_samples::fails;

fn control(json: &str, calibrated: bool) -> Control {
    let growth = if calibrated { Growth::Factors(vec![1.5, 2.0, 4.0]) } else { Growth::Unknown };
    let fields = vec![("U".to_string(), growth), ("p".to_string(), Growth::Unknown)];
    Control::new(fields, ControlSettings::parse(json).unwrap()).unwrap()
}

/// Of fields whose errors do not grow.
fn steady<const N: usize>(fields: [&str; N], json: &str) -> Control {
    let fields = fields.map(|name| (name.to_string(), Growth::None)).into();
    Control::new(fields, ControlSettings::parse(json).unwrap()).unwrap()
}

fn stride(error: f64) -> [StrideError; 2] {
    let one = |error| StrideError { error, change: 0.3, size: 0.0, variation: 2.0 };
    [one(error), one(1.0)]
}

#[test]
fn strides_are_those_that_keep_the_estimate_within_the_tolerance() {
    let mut c = control(r#"{"tolerance": 0.05}"#, true);
    assert_eq!((c.strides(10), c.error()), (0, f64::INFINITY), "nothing measured");
    c.measure(&stride(0.04)).unwrap();
    // 0.02 times 1.5, 2 and 4
    assert_eq!(c.strides(10), 2);
    assert_eq!(c.strides(1), 1);
    assert!((c.error() - 0.02).abs() < 1e-15 && (c.estimate(3) - 0.08).abs() < 1e-15);
    // No further than it was calibrated
    c.measure(&stride(0.001)).unwrap();
    assert_eq!((c.strides(10), c.estimate(4)), (3, f64::INFINITY));
    c.measure(&stride(0.2)).unwrap();
    assert_eq!(c.strides(10), 0);
    for bad in [f64::NAN, f64::INFINITY, -0.04] {
        c.measure(&stride(bad)).unwrap();
        assert_eq!((c.strides(10), c.error()), (0, f64::INFINITY));
    }
    assert_eq!(c.not_calibrated(), [""; 0]);
}

#[test]
fn a_stride_that_is_off_by_too_much_of_the_solvers_change_allows_nothing() {
    let mut c = control(r#"{"tolerance": 0.05}"#, true);
    c.measure(&stride(0.001)).unwrap();
    assert_eq!(c.strides(10), 3);
    // Within the tolerance: 0.0005 of the size
    let mut rests = stride(0.001);
    rests[0].change = 0.002;
    c.measure(&rests).unwrap();
    assert_eq!((c.strides(10), c.error()), (0, 0.0005));
    // A run that is carried on from there does not jump either
    let mut carried_on = control(r#"{"tolerance": 0.05}"#, true);
    carried_on.restore(&c.state().unwrap()).unwrap();
    assert_eq!(carried_on.strides(10), 0);
    let mut lenient = control(r#"{"tolerance": 0.05, "relTol": 0.6}"#, true);
    lenient.measure(&rests).unwrap();
    assert_eq!(lenient.strides(10), 3);
    rests[0].change = 0.0051;
    c.measure(&rests).unwrap();
    assert_eq!(c.strides(10), 3);
    // A surrogate that is not off at all holds a flow at rest
    (rests[0].error, rests[0].change) = (0.0, 0.0);
    c.measure(&rests).unwrap();
    assert_eq!(c.strides(10), 10);
    // p, which none of these watches, is off by more
    let mut both = control(r#"{"tolerance": 5, "fields": ["U", "p"]}"#, true);
    both.measure(&stride(0.001)).unwrap();
    assert_eq!(both.strides(10), 0);
}

#[test]
fn an_infinite_error_of_an_infinite_field_allows_nothing() {
    let mut c = control(r#"{"tolerance": 0.05}"#, true);
    let mut rows = stride(f64::INFINITY);
    rows[0].variation = f64::INFINITY;
    c.measure(&rows).unwrap();
    assert_eq!((c.strides(10), c.error()), (0, f64::INFINITY));
}

#[test]
fn without_an_error_a_jump_is_as_long_as_it_may_be() {
    let mut c = control(r#"{"tolerance": 0.05}"#, false);
    c.measure(&stride(0.0)).unwrap();
    assert_eq!(c.strides(usize::MAX), usize::MAX);
    c.measure(&stride(2e-300)).unwrap();
    assert_eq!(c.strides(1_000_000_000), 1_000_000_000);
}

#[test]
fn without_calibration_errors_add_up() {
    let mut c = control(r#"{"tolerance": 0.05, "fields": ["U", "p"]}"#, false);
    assert_eq!(c.not_calibrated(), ["U", "p"]);
    let mut both = stride(0.02);
    both[1].error = 0.04;
    c.measure(&both).unwrap();
    // p: 0.02 a stride
    assert_eq!(c.strides(10), 2);
    c.measure(&stride(0.0)).unwrap();
    assert_eq!(c.strides(10), 0, "p is off by half of itself");
}

#[test]
fn errors_that_do_not_grow_let_a_jump_be_as_long_as_it_may() {
    let mut c = steady(["U", "p"], r#"{"tolerance": 0.05}"#);
    c.measure(&stride(0.04)).unwrap();
    assert_eq!((c.strides(200), c.estimate(200)), (200, 0.02));
    c.measure(&stride(0.2)).unwrap();
    assert_eq!(c.strides(200), 0);
}

#[test]
fn the_size_and_the_change_are_the_largest_so_far() {
    let mut c = control(r#"{"tolerance": 0.05}"#, true);
    c.measure(&stride(0.04)).unwrap();
    let mut calm = stride(0.04);
    calm.iter_mut().for_each(|s| (s.variation, s.change) = (0.0, 0.0));
    c.measure(&calm).unwrap();
    assert_eq!(c.error(), 0.02);
    assert_eq!(c.refuses(&[0.89, 0.1]).unwrap(), None);
    let reason = c.refuses(&[0.91, 0.1]).unwrap().unwrap();
    assert!(reason.contains("change U by 9.10e-1, more than 3 times"), "{reason}");
    assert!(c.refuses(&[0.1, f64::NAN]).unwrap().is_some());
    assert!(c.refuses(&[0.1]).is_err());
}

#[test]
fn a_surrogate_that_stays_bad_ends_the_run_where_that_is_asked_for() {
    let mut c = control(r#"{"tolerance": 0.01, "onFailure": "stop", "patience": 3}"#, true);
    [1.0, 1.0, 0.0, 1.0, 1.0].iter().for_each(|error| c.measure(&stride(*error)).unwrap());
    fails(c.measure(&stride(1.0)), &["3 strides in a row", "onFailure solver"]);
    let mut goes_on = control(r#"{"tolerance": 0.01, "patience": 3}"#, true);
    (0..20).for_each(|_| goes_on.measure(&stride(1.0)).unwrap());
}

#[test]
fn bad_settings_are_named() {
    for (json, words) in [
        ("{}", "tolerance"),
        (r#"{"tolerance": 0}"#, "above 0"),
        (r#"{"tolerance": 0.1, "tolerence": 1}"#, "tolerence"),
        (r#"{"tolerance": 0.1, "fields": []}"#, "at least one"),
        (r#"{"tolerance": 0.1, "onFailure": "maybe"}"#, "onFailure"),
        (r#"{"tolerance": 0.1, "patience": 0}"#, "patience"),
        (r#"{"tolerance": 0.1, "relTol": 0}"#, "relTol 0"),
    ] {
        fails(ControlSettings::parse(json), &[words]);
    }
    let settings = ControlSettings::parse(r#"{"tolerance": 0.1, "fields": ["q"]}"#).unwrap();
    let fields = ["U", "p"].map(|name| (name.to_string(), Growth::Unknown));
    fails(Control::new(fields.into(), settings), &["q is not predicted", "U, p"]);
}

#[test]
fn a_restored_controller_decides_as_the_one_before() {
    let mut first = control(r#"{"tolerance": 0.05, "onFailure": "stop", "patience": 2}"#, true);
    assert_eq!(first.state(), None, "nothing measured");
    first.measure(&stride(0.04)).unwrap();
    first.measure(&stride(1.0)).unwrap();
    let mut saved = first.state().unwrap();
    let mut second = control(r#"{"tolerance": 0.05, "onFailure": "stop", "patience": 2}"#, true);
    second.restore(&saved).unwrap();
    assert_eq!(second.state(), first.state());
    assert_eq!((second.strides(10), second.error()), (0, 0.5));
    assert!(second.measure(&stride(1.0)).is_err(), "the second bad stride in a row");
    saved.fields[1].variation = f64::NAN;
    assert!(second.restore(&saved).is_err());
    saved.fields.pop();
    assert!(second.restore(&saved).is_err());
}

#[test]
fn relative_errors_are_those_of_the_watched_fields() {
    let mut c = control(r#"{"tolerance": 0.05}"#, true);
    c.measure(&stride(0.04)).unwrap();
    assert_eq!(c.relative(&[0.1, 50.0]).unwrap(), 0.05);
    assert_eq!(c.relative(&[f64::NAN, 0.0]).unwrap(), f64::INFINITY);
    assert!(c.relative(&[0.1]).is_err());
}

#[test]
fn the_first_field_that_varies_is_watched_where_none_is_named() {
    let control = || steady(["DT", "T", "p"], r#"{"tolerance": 0.05}"#);
    let still = StrideError { error: 0.0, change: 0.0, size: 4.0, variation: 0.0 };
    let row = |error| StrideError { error, change: 1.0, size: 300.0, variation: 10.0 };
    let mut c = control();
    c.measure(&[still, row(0.9), row(0.1)]).unwrap();
    // T is off by nine tenths of what it changed.
    assert_eq!((c.error(), c.strides(8)), (0.09, 0));
    c.measure(&[still, row(0.1), row(0.9)]).unwrap();
    assert_eq!((c.error(), c.strides(8)), (0.01, 8));
    let mut again = control();
    again.restore(&c.state().unwrap()).unwrap();
    assert_eq!(again.error(), 0.01);
    // DT is uniform, and all that it varies by is rounding: so it stays in a run that is carried on.
    let rounding = StrideError { error: 1e-13, change: 1e-13, size: 4.0, variation: 1e-13 };
    let mut c = control();
    c.measure(&[rounding, row(0.1), row(0.9)]).unwrap();
    again.restore(&c.state().unwrap()).unwrap();
    assert_eq!((again.error(), again.held()), (0.01, vec!["T"]));
    // Among those that may be, and the one that is named whatever it does.
    let mut c = control().among(&["p".into()]);
    c.measure(&[still, row(0.9), row(0.1)]).unwrap();
    assert_eq!(c.error(), 0.01);
    let mut c = steady(["DT", "T", "p"], r#"{"tolerance": 0.05, "fields": ["DT"]}"#);
    c.measure(&[still, row(0.9), row(0.1)]).unwrap();
    assert_eq!(c.error(), 0.0);
}
