use super::*;
use clap::Parser;
use m4gn_mesh::NodeType;
use m4gn_model::SegmentMethod;
use m4gn_samples::mesh as sample;

#[derive(Debug, Parser)]
struct Line {
    #[command(flatten)]
    args: Args,
}

fn args(line: &str) -> std::result::Result<Args, String> {
    let words = std::iter::once("segment").chain(line.split_whitespace());
    Line::try_parse_from(words).map(|l| l.args).map_err(|e| e.to_string())
}

/// What is cut on this mesh, without a case or a model that says anything.
fn spec(line: &str, mesh: &Mesh) -> Result<SegmentSpec> {
    let args = args(line).unwrap();
    fitted(wanted(&args, None, &SegmentEntries::default())?, args.modes.is_none(), mesh)
}

#[test]
fn bad_usage() {
    for (line, text) in [
        ("case --segments 99999", "8192"),
        ("case --method slick", "expected one of metis, slic"),
        ("case --node-type cylinder", "PATCH=TYPE"),
        ("case --node-type cylinder=fluid", "wall, inlet"),
        ("case --node-type =wall", "PATCH=TYPE"),
        ("--segments 3", "CASE|DATA"),
    ] {
        m4gn_samples::fails(args(line), &[text]);
    }
    let good = args("case --node-type cylinder=obstacle --method slic").unwrap();
    assert_eq!(good.node_type, [("cylinder".to_string(), NodeType::Obstacle)]);
    assert_eq!(good.method, Some(SegmentMethod::Slic));
}

#[test]
fn entries_are_the_commands_own_or_those_of_a_dictionary() {
    let mesh = sample::rectangle(10, 10, 1.0, 1.0);
    let s = spec("case", &mesh).unwrap();
    assert_eq!((s.count, s.method, s.modes), (36, SegmentMethod::Slic, 6));
    let line = "case --segments 16 --method metis --set connected=false --set tau=0.5 --set size=0.1";
    let s = spec(line, &mesh).unwrap();
    assert_eq!((s.count, s.method, s.connected), (16, SegmentMethod::Metis, false));
    assert_eq!((s.tau, s.size), (0.5, Some(0.1)));
    assert!(spec("case --set taw=1", &mesh).unwrap_err().to_string().contains("is tau meant?"));
}

/// A chain of four cells with two segments, known on paper: one of three edges is cut, and each segment has a volume of 3
/// (degrees 1 + 2) that one edge leaves.
#[test]
fn a_chain_on_paper() {
    let (mesh, comm) = (sample::chain(4, 4.0), Comm::serial());
    let spec = spec("case --segments 2 --method metis --modes 0", &mesh).unwrap();
    let cut = Cut::new(&mesh, &mut Graph::new(&mesh, &comm).unwrap(), &spec, &comm).unwrap();
    let json = cut.json();
    for figure in ["conductance", "edge_cut_ratio"] {
        assert!((json[figure].as_f64().unwrap() - 1.0 / 3.0).abs() < 1e-12, "{json}");
    }
    // Ends: a = 1, b = 2.5; inner cells: a = 1, b = 1.5.
    assert!((json["silhouette"].as_f64().unwrap() - 0.5 * (1.5 / 2.5 + 0.5 / 1.5)).abs() < 1e-9, "{json}");
    assert_eq!((&json["smallest"], &json["largest"], &json["sweeps"]), (&2.into(), &2.into(), &0.into()));
    assert_eq!((&json["eigenvalues"], &json["converged"]), (&serde_json::json!([]), &true.into()));
    assert!(cut.text().starts_with("metis, 2 segments of 2 to 2 cells in "), "{}", cut.text());
    assert!(!cut.text().contains("METIS had put"), "{}", cut.text());
}

/// The first two of three modes, each with a displacement in two directions.
#[test]
fn an_elastic_mode_is_told_once_and_in_its_unit() {
    let (mut mesh, comm) = (sample::rectangle(4, 1, 4.0, 1.0), Comm::serial());
    mesh.elastic = Some(m4gn_mesh::ElasticModes {
        eigenvalues: vec![4.0, 9.0, 16.0],
        vectors: vec![vec![[0.0, 1.0, 0.0]; 4]; 3],
    });
    let spec = spec("case --segments 2 --method metis --modes 2", &mesh).unwrap();
    let cut = Cut::new(&mesh, &mut Graph::new(&mesh, &comm).unwrap(), &spec, &comm).unwrap();
    assert_eq!((cut.modes.vectors.len(), &cut.json()["eigenvalues"]), (4, &serde_json::json!([4.0, 9.0])));
    let text = cut.text();
    assert!(text.starts_with("2 modes in ") && text.contains("eigenvalues [1/s2] "), "{text}");
}

/// Methods that need an obstacle say so.
#[test]
fn no_wall_no_distance_to_it() {
    let (mut mesh, comm) = (sample::rectangle(3, 2, 3.0, 2.0), Comm::serial());
    mesh.boundary.clear();
    let spec = spec("case --segments 2 --method slic-mdode --modes 1", &mesh).unwrap();
    let error = Cut::new(&mesh, &mut Graph::new(&mesh, &comm).unwrap(), &spec, &comm).err().unwrap();
    assert!(error.to_string().contains("obstacle"), "{error}");
}
