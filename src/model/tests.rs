use super::*;
use sample::{bodies, spec};

#[test]
fn units() {
    let of = |dimensions| {
        let field = FieldSpec { dimensions, ..spec().fields[0].clone() };
        field.unit()
    };
    assert_eq!(of([0, 1, -1, 0, 0, 0, 0]), "m/s");
    assert_eq!(of([1, -1, -2, 0, 0, 0, 0]), "kg/m/s^2");
    assert_eq!(of([0, 2, -2, 0, 0, 0, 0]), "m^2/s^2");
    assert_eq!((of([0; 7]), of([0, 0, -1, 0, 0, 0, 0])), ("1".into(), "1/s".into()));
}

#[test]
fn positive_fields_stay_so() {
    let linear = &spec().fields[1];
    assert_eq!((linear.seen(-3.0), linear.physical(-3.0)), (-3.0, -3.0));
    let k = FieldSpec { name: "k".into(), floor: Some(1e-6), ..linear.clone() };
    for x in [1e-6, 0.5, 1.0, 1e9] {
        assert!((k.physical(k.seen(x)) / x - 1.0).abs() < 1e-12);
    }
    for below in [0.0, -1.0, f64::NEG_INFINITY, 1e-7] {
        assert!((k.physical(k.seen(below)) / 1e-6 - 1.0).abs() < 1e-12);
        assert_eq!(k.physical(-1e3 + below), 1e-6);
    }
    assert!(k.seen(f64::NAN).is_nan() && k.physical(f64::NAN).is_nan() && k.physical(1e3).is_infinite());
    let json = serde_json::to_string(&k).unwrap();
    assert_eq!(serde_json::from_str::<FieldSpec>(&json).unwrap(), k);
    // Models from before there were floors
    assert!(!serde_json::to_string(linear).unwrap().contains("floor"));
}

#[test]
fn features_of_bodies_are_counted() {
    let s = bodies();
    assert!(s.check().is_ok());
    let counts = (s.n_field_inputs(), s.n_node_features(), s.n_edge_features());
    assert_eq!(counts, (8, 14, 13));
}

#[test]
fn features_are_counted() {
    let s = spec();
    assert_eq!((s.n_field_inputs(), s.n_node_features(), s.n_edge_features(), s.n_outputs()), (3, 9, 3, 3));
}

#[test]
fn descriptions_survive_json() {
    let s = spec();
    assert_eq!(serde_json::from_str::<ModelSpec>(&serde_json::to_string(&s).unwrap()).unwrap(), s);
    let unknown = serde_json::to_string(&s).unwrap().replacen("\"dim\"", "\"dimm\"", 1);
    assert!(serde_json::from_str::<ModelSpec>(&unknown).is_err());
}
