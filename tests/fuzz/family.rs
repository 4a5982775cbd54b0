//! Fuzz targets: a family's description, and the file of a study. See `tests/fuzzing/mod.rs` of the repository.

#[path = "../fuzzing/mod.rs"]
mod fuzzing;

use fuzzing::{Random, fuzz};
use m4gn_train::config::Config;
use m4gn_workbench::generate::family::Family;
use m4gn_workbench::generate::parameter::{Settings, parse_setting};
use m4gn_workbench::study::Plan;
use std::path::Path;

/// What an expression, a name or a number of the family may be in its place.
const PIECES: &str = "1e308|-1e308|inf|nan|0|-0.0|1e-320|9007199254740993|**|*|/|-|(|)| if | else | and |not |sqrt(|steps(|max(|'|\"|@u0@";

/// Damages a text in up to three ways.
fn damage(bytes: &mut Vec<u8>, r: &mut Random) {
    for _ in 0..1 + r.below(3) {
        match r.below(3) {
            0 => r.damage(bytes),
            1 => {
                let at = r.below(bytes.len());
                r.damage_number(bytes, at);
            }
            // A piece, or many of it, in a random place.
            _ => {
                let pieces: Vec<&str> = PIECES.split('|').collect();
                let piece = r.pick(&pieces).repeat(*r.pick(&[1, 1, 1, 2, 30, 5000]));
                let at = r.below(bytes.len() + 1);
                bytes.splice(at..at, piece.bytes());
            }
        }
    }
}

/// What is read draws, or says why not; what it draws is finite.
fn draw(family: &Family, r: &mut Random) {
    let name = family.parameters.first().map_or("u0", |p| &p.name).to_string();
    let value = *r.pick(&["1", "0.5:2", "-1e308:1e308", "1e-9:2e-9", "square"]);
    let mut settings = Settings::new();
    if r.below(2) == 0
        && let Ok((name, setting)) = parse_setting(&format!("{name}={value}"))
    {
        settings.insert(name, setting);
    }
    let _ = family.parameter_help();
    for index in [0, u64::MAX] {
        let Ok(draw) = family.draw(r.integer() as u64, index, &settings) else {
            continue;
        };
        assert!(draw.variables.values().all(|v| v.is_finite()), "{:?}", draw.variables);
        for p in &family.parameters {
            assert!(p.above.is_none_or(|above| draw.variables[&p.name] > above), "{}", p.name);
        }
        let _ = (draw.text(&family.label), family.programs(&draw));
        for interval in [family.recording.interval, 1e-300, 1e300] {
            let _ = family.steps(&draw, interval);
        }
    }
}

#[test]
fn family_description() {
    let templates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openfoam/templates");
    let mut paths: Vec<_> = std::fs::read_dir(templates)
        .unwrap()
        .map(|f| f.unwrap().path().join("family.toml"))
        .filter(|f| f.is_file())
        .collect();
    paths.sort();
    let good: Vec<Vec<u8>> = paths.iter().map(|p| std::fs::read(p).unwrap()).collect();
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("fuzz");
    std::fs::create_dir(&folder).unwrap();
    fuzz("family", |r| {
        let mut bytes = r.pick(&good).clone();
        damage(&mut bytes, r);
        std::fs::write(folder.join("family.toml"), &bytes).unwrap();
        if let Ok(family) = Family::load(&folder) {
            draw(&family, r);
        }
        bytes.len()
    });
}

/// The file of a study, and the configuration that its networks share: what is read gives configurations, or says why not.
#[test]
fn study() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let read = |name: &str| std::fs::read(configs.join(name)).unwrap();
    let good = [read("study/cylinder-flow.toml"), read("study/switches.toml"), read("study/solids.toml")];
    let shared =
        ["kind-m4gn.toml", "cylinder-flow.toml", "deforming-bodies.toml"].map(|name| (name, read(name)));
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("study");
    std::fs::create_dir(&folder).unwrap();
    fuzz("study", |r| {
        let (mut bytes, mut shared) = (r.pick(&good).clone(), shared.clone());
        match r.below(2) {
            0 => damage(&mut bytes, r),
            _ => shared.iter_mut().for_each(|(_, bytes)| damage(bytes, r)),
        }
        std::fs::write(folder.join("study.toml"), &bytes).unwrap();
        shared.iter().for_each(|(name, bytes)| std::fs::write(dir.path().join(name), bytes).unwrap());
        if let Ok(plan) = Plan::read(&folder.join("study.toml")) {
            for (data, network, _) in plan.cells() {
                let _ = plan.config(data, network).and_then(|text| Config::parse(&text));
            }
        }
        bytes.len() + shared.iter().map(|(_, bytes)| bytes.len()).sum::<usize>()
    });
}
