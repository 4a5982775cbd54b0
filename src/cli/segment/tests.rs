use super::*;
use clap::Parser;
use m4gn_mesh::NodeType;
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

/// What is compared on the data set's mesh, without a case or a model that says anything.
fn options(line: &str, mesh: &Mesh) -> Result<Options> {
    let args = args(line).unwrap();
    let wanted = Wanted::new(&args, None, &SegmentEntries::default())?;
    wanted.options(&args, mesh)
}

#[test]
fn bad_usage() {
    for (line, text) in [
        ("case --segments 0", "expected a number from 1"),
        ("case --sweep 4,x", "expected a number from 1"),
        ("case --sweep 4,99999", "8192"),
        ("case --method slick", "expected metis, slic-md"),
        ("case --node-type cylinder", "PATCH=TYPE"),
        ("case --node-type cylinder=fluid", "wall, inlet"),
        ("case --node-type =wall", "PATCH=TYPE"),
        ("--segments 3", "CASE|DATA"),
    ] {
        let message = args(line).unwrap_err();
        assert!(message.contains(text), "{line}: {message}");
    }
    let good = args("case --node-type cylinder=obstacle --method slic,metis").unwrap();
    assert_eq!(good.node_type, [("cylinder".to_string(), NodeType::Obstacle)]);
    assert_eq!(good.method, [SegmentMethod::Slic, SegmentMethod::Metis]);
}

#[test]
fn numbers_of_segments_and_methods() {
    let mesh = sample::rectangle(10, 10, 1.0, 1.0);
    let o = options("case", &mesh).unwrap();
    assert_eq!((o.counts, o.methods.len(), o.spec.modes), (vec![36], 4, 6));
    let o = options("case --sweep 9,4,9 --method metis,metis", &mesh).unwrap();
    assert_eq!((o.counts, o.methods), (vec![4, 9], vec![SegmentMethod::Metis]));
    let o =
        options("case --sweep 9,4 --segments 16 --set connected=false --set tau=0.5 --set size=0.1", &mesh)
            .unwrap();
    assert_eq!((o.counts, o.spec.connected), (vec![4, 9, 16], false));
    assert_eq!((o.spec.tau, o.spec.size), (0.5, Some(0.1)));
    assert!(options("case --set taw=1", &mesh).unwrap_err().to_string().contains("is tau meant?"));
    let error = options("case --segments 101", &mesh).unwrap_err().to_string();
    assert!(error.contains("101 segments for 100 cells: expected 1 to 100"), "{error}");
    assert!(options("case --set tau=-1", &mesh).is_err());
    let error = options(r#"case --set obstacles=["wing"]"#, &mesh).unwrap_err().to_string();
    assert!(error.contains("wing is no patch"), "{error}");
}

#[test]
fn two_cells_have_one_mode() {
    let mesh = sample::chain(2, 1.0);
    let o = options("case --segments 2", &mesh).unwrap();
    assert_eq!(o.spec.modes, 1);
    // Who asks for more is told.
    let error = options("case --segments 2 --modes 2", &mesh).unwrap_err().to_string();
    assert!(error.contains("2 modes of 2 cells: expected at most 1"), "{error}");
}
