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
