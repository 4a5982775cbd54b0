//! Fuzz targets: a family's description, the file of a study, and the files of a campaign.

use crate::fuzzing::{Random, fuzz};
use m4gn_train::config::Config;
use m4gn_workbench::campaign::{dakota, order, record, sampling, settings, table};
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

/// The files that a campaign goes on from: what is read is in its ranges, or is refused.
#[test]
fn campaign() {
    let good = [
        (settings::FILE, CAMPAIGN),
        (table::FILE, "case_name,Uin,shape\n# two\nr01,1.5,square\nr02,2,round\nr03,2.5e0,square\n"),
        (record::DONE, RECORD),
        ("params.in", DAKOTA[0]),
        ("params.in", DAKOTA[1]),
    ];
    let dir = tempfile::tempdir().unwrap();
    let now: record::Record = serde_json::from_str(RECORD).unwrap();
    fuzz("campaign", |r| {
        let damaged = r.below(good.len());
        let mut size = 0;
        for (k, (name, text)) in good.iter().enumerate() {
            let mut bytes = text.as_bytes().to_vec();
            if k == damaged {
                damage(&mut bytes, r);
            }
            size += bytes.len();
            // Of the two of Dakota the damaged one
            if k < 4 || k == damaged {
                std::fs::write(dir.path().join(name), &bytes).unwrap();
            }
        }
        if let Ok(settings) = settings::Settings::read(dir.path()) {
            assert!(settings.ranks > 0 && settings.jobs > 0 && !settings.solver.is_empty());
            let _ = settings.check_quantities(dir.path());
        }
        if let Ok(table) = table::Table::read(dir.path()) {
            let places = table.places();
            assert!(places.iter().flatten().all(|v| (0.0..=1.0).contains(v)), "{places:?}");
            let mut order = order::spread(&places);
            order.sort_unstable();
            assert!(order.iter().copied().eq(0..table.rows.len()));
            assert!(
                table.text().is_ok() && sampling::held_out(table.rows.len(), 0.1).len() <= table.rows.len()
            );
            let asked = dakota::Request::read(&dir.path().join("params.in"));
            if let Ok(values) = asked.map_err(|e| e.to_string()).and_then(|asked| asked.values(&table)) {
                let added = table::with_row(dir.path(), values.clone());
                let now = table::Table::read(dir.path()).unwrap();
                match added {
                    Ok(row) => {
                        let again = table::with_row(dir.path(), values).unwrap();
                        assert_eq!(again, row, "it is found, not appended again");
                        assert!(now.rows.iter().any(|r| r.name == row));
                    }
                    Err(e) => assert_eq!(now.rows.len(), table.rows.len(), "{e}"),
                }
            }
        }
        let _ = record::state(dir.path(), &now.made_from);
        size
    });
}

/// What Dakota asks for, in both of its formats.
const DAKOTA: [&str; 2] = [
    "2 variables\n1.900000000000000e+00 Uin\nround shape\n2 functions\n1 ASV_1:Cd\n0 ASV_2:lift\n1 derivative_variables\n1 DVV_1:Uin\n0 \
     analysis_components\n3:2 eval_id\n0 metadata\n",
    "{ DAKOTA_VARS = 2 }\n{ Uin = 2.000000000000000e+00 }\n{ shape = \"round\" }\n{ DAKOTA_FNS = 1 }\n{ ASV_1:Cd = 1 }\n{ DAKOTA_DER_VARS = 0 \
     }\n{ DAKOTA_AN_COMPS = 0 }\n{ DAKOTA_EVAL_ID = 1 }\n",
];

const CAMPAIGN: &str = r#"case = "case"
prepare = [["blockMesh"], ["./Allrun.pre", "-v"]]
solver = ["icoFoam"]
ranks = 2
start = "nearest"
scale = "Uin"
surrogate = "dmd"
surrogate_entries = "timeStart 1;"
stop = true
min_time = 1.5
end_time = 8.0
confidence = 0.95
held_out = 0.1
jobs = 2
time_limit = 3600
[[quantity]]
name = "Cd"
function_object = "forces"
result = "Cd"
relative = 0.01
[[quantity]]
name = "lift"
function_object = "forces"
result = "Cl"
component = "x"
statistic = "rms"
tolerance = 0.02
"#;

const RECORD: &str = r#"{
  "case_name": "r02",
  "parameters": { "Uin": "1.9" },
  "start": { "kind": "nearest", "sister": "r01", "ratio": 1.1, "mapped": false, "note": null },
  "quantities": { "Cd": { "value": 2.1, "half_width": 0.004, "known": true }, "lift": { "value": 0.22, "half_width": null, "known": false } },
  "end_time": 3.25,
  "last": "3.25",
  "cost": { "prepare": 0.4, "start": 0.1, "solver": 2.2, "surrogate": 0.0, "wall": 3.1 },
  "made_from": { "system/controlDict": "1f2e3d4c", "parameters": "0a1b2c3d" }
}"#;
