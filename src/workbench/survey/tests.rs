use super::*;
use m4gn_mesh::NodeType;
use m4gn_samples::mesh as sample;

fn options(methods: &[SegmentMethod], counts: &[usize], modes: usize) -> Options {
    Options {
        spec: SegmentSpec { modes, ..SegmentSpec::default() },
        methods: methods.to_vec(),
        counts: counts.to_vec(),
    }
}

fn run(mesh: &Mesh, options: &Options) -> Result<Survey> {
    let comm = Comm::serial();
    let mut graph = Graph::new(mesh, &comm)?;
    Survey::run(mesh, &mut graph, options, &comm, |_, _, _| Ok(()))
}

/// A chain of four cells with two segments, known on paper: one of three edges is cut, and each segment has a volume of 3
/// (degrees 1 + 2) that one edge leaves.
#[test]
fn a_chain_on_paper() {
    let mesh = sample::chain(4, 4.0);
    let survey = run(&mesh, &options(&[SegmentMethod::Metis], &[2], 0)).unwrap();
    let e = &survey.entries[0];
    assert_eq!((e.cells, e.sweeps.len(), e.converged()), ([2, 2], 0, true));
    assert!((e.quality.conductance - 1.0 / 3.0).abs() < 1e-12);
    assert!((e.quality.edge_cut_ratio - 1.0 / 3.0).abs() < 1e-12);
    // Ends: a = 1, b = 2.5; inner cells: a = 1, b = 1.5.
    assert!((e.quality.silhouette - 0.5 * (1.5 / 2.5 + 0.5 / 1.5)).abs() < 1e-9);
    assert!(e.mode_silhouette.is_none() && survey.modes_text().is_empty());
    let json = survey.json();
    assert_eq!(json["eigenvalues"], serde_json::json!([]));
    assert_eq!(json["methods"][0]["method"], "metis");
    assert_eq!(json["methods"][0]["k"], 2);
    assert!((json["methods"][0]["edge_cut_ratio"].as_f64().unwrap() - 1.0 / 3.0).abs() < 1e-12);
}

#[test]
fn all_methods_and_the_suggestion() {
    let mut mesh = sample::triangles(6, 4, 3.0, 2.0);
    mesh.boundary.iter_mut().for_each(|b| b.kind = NodeType::Inlet);
    let survey = run(&mesh, &options(&SegmentMethod::ALL, &[2, 4, 8], 3)).unwrap();
    // No wall anywhere: two methods are left out, with a reason, once each.
    let skipped: Vec<_> = survey.skipped.iter().map(|s| s.method).collect();
    assert_eq!(skipped, [SegmentMethod::SlicLog, SegmentMethod::SlicExp]);
    assert_eq!(survey.entries.len(), 6);
    assert_eq!(survey.modes.eigenvalues.len(), survey.json()["eigenvalues"].as_array().unwrap().len());
    let notes = survey.notes();
    assert!(notes.contains("slic-mdodl does not apply: ") && notes.contains("suggested K"), "{notes}");
    let best = survey.suggestion(SegmentMethod::Metis).unwrap();
    let all = survey.entries.iter().filter(|e| e.method == SegmentMethod::Metis);
    assert!(all.clone().all(|e| e.quality.silhouette <= best.quality.silhouette));
    assert_eq!(survey.json()["suggested"]["metis"], best.count);
    assert_eq!(survey.table().rows.len(), 6);
    assert!(survey.suggestion(SegmentMethod::SlicExp).is_none());

    mesh.boundary[0].kind = NodeType::Obstacle;
    let survey = run(&mesh, &options(&SegmentMethod::ALL, &[4], 3)).unwrap();
    assert!(survey.skipped.is_empty() && survey.entries.len() == 4);
}

#[test]
fn one_segment_and_a_cell_each() {
    let mesh = sample::rectangle(3, 2, 3.0, 2.0);
    let survey = run(&mesh, &options(&[SegmentMethod::Slic], &[1, 6], 2)).unwrap();
    let figures = |e: &Entry| (e.quality.edge_cut_ratio, e.quality.silhouette, e.cells);
    assert_eq!(figures(&survey.entries[0]), (0.0, 0.0, [6, 6]));
    assert_eq!(figures(&survey.entries[1]), (1.0, 0.0, [1, 1]));
}

#[test]
fn what_cannot_be_is_refused() {
    let mesh = sample::rectangle(3, 2, 3.0, 2.0);
    for counts in [[0], [7]] {
        assert!(run(&mesh, &options(&[SegmentMethod::Metis], &counts, 0)).is_err());
    }
    let mut open = mesh.clone();
    open.boundary.clear();
    // Only methods that need an obstacle: the reason is the error.
    let error = run(&open, &options(&[SegmentMethod::SlicExp], &[2], 1)).unwrap_err();
    assert!(error.to_string().contains("obstacle"), "{error}");
    let mut calls = 0;
    let stopped = Survey::run(
        &mesh,
        &mut Graph::new(&mesh, &Comm::serial()).unwrap(),
        &options(&[SegmentMethod::Metis], &[2, 3], 0),
        &Comm::serial(),
        |done, of, _| {
            assert_eq!((done, of), (calls, 3));
            calls += 1;
            if done < 2 { Ok(()) } else { Err(Error::Interrupted("stopped".into())) }
        },
    );
    assert!(matches!(stopped, Err(Error::Interrupted(_))));
}

#[test]
fn a_picture_of_segments_and_modes() {
    let mesh = sample::triangles(6, 4, 3.0, 2.0);
    let survey = run(&mesh, &options(&[SegmentMethod::Metis, SegmentMethod::Slic], &[5], 2)).unwrap();
    let map = m4gn_report::CellMap::from_mesh(&mesh, 100).unwrap();
    let (width, height) = (map.width, map.height);
    let what = Pictured { counts: vec![5], modes: 4 };
    let raster = picture(&survey, &mesh, map, &what);
    assert!(raster.width > 2 * width && raster.height > 2 * height);
    raster.png().unwrap();
}
