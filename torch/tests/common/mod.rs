//! Small synthetic trajectories and configurations.
#![allow(dead_code)]

use m4gn::dataset::{FieldMeta, Frame, Split, WriteOptions, Writer};
use m4gn::mesh::sample;
use std::path::Path;

/// Writes `count` trajectories of a vortex that is carried along a channel, frames every 0.01 s.
pub fn write_data(folder: &Path, count: usize) {
    for number in 0..count {
        let mesh = sample::triangles(6, 4, 1.5, 1.0);
        let options = WriteOptions {
            fields: vec![
                FieldMeta {
                    name: "U".into(),
                    vector: true,
                    dimensions: [0, 1, -1, 0, 0, 0, 0],
                },
                FieldMeta {
                    name: "p".into(),
                    vector: false,
                    dimensions: [0, 2, -2, 0, 0, 0, 0],
                },
            ],
            provenance: serde_json::json!({ "application": "test" }),
            split: if number + 1 == count {
                Split::Valid
            } else {
                Split::Train
            },
            overwrite: false,
        };
        let mut writer = Writer::create(folder.join(format!("{number:03}.h5")), &mesh, &options).unwrap();
        for frame in 0..30 {
            let time = 0.01 * frame as f64;
            let centre = [0.3 + 0.1 * number as f64 + time, 0.5];
            let flow = |x: [f64; 3]| {
                let r = [x[0] - centre[0], x[1] - centre[1]];
                let swirl = (-8.0 * (r[0] * r[0] + r[1] * r[1])).exp();
                (
                    [(1.0 - 3.0 * swirl * r[1]) as f32, (3.0 * swirl * r[0]) as f32],
                    -swirl as f32,
                )
            };
            let mut frames = vec![Frame::default(), Frame::default()];
            for &x in &mesh.cell_centres {
                let (u, p) = flow(x);
                frames[0].cells.extend(u);
                frames[1].cells.push(p);
            }
            for face in &mesh.boundary {
                let outlet = face.kind == m4gn::mesh::NodeType::Outlet;
                let (u, p) = flow(mesh.cell_centres[face.owner as usize]);
                frames[0].boundary.extend(if outlet { u } else { [0.5, 0.0] });
                frames[1].boundary.push(if outlet { 0.0 } else { p });
            }
            writer.append(time, &frames).unwrap();
        }
        writer.finish().unwrap();
    }
}

/// A small network; `training` is appended to the `[training]` table.
pub fn config(training: &str) -> String {
    format!(
        r#"
        [model]
        stride = 0.02
        width = 16
        hidden_layers = 1
        activation = "relu"
        layers_before = 1
        layers_after = 1
        fields = [{{ name = "U", input = true, output = "delta" }}, {{ name = "p", input = true, output = "value" }}]
        [macro]
        layers = 1
        heads = 2
        ffn_width = 16
        rwse_steps = 3
        centroids = true
        offsets = true
        [segments]
        method = "metis"
        count = 4
        [training]
        batch_size = 3
        micro_batch = 2
        learning_rate = 2e-3
        decay_steps = 1000
        noise = {{ U = 0.01, p = 0.01 }}
        mirror = true
        ema_decay = 0.9
        gradient_clip = 1.0
        unroll = [[0, 1], [6, 2]]
        normaliser_steps = 4
        normaliser_warmup = 2
        validation_horizon = 0.1
        log_interval = 2
        {training}
    "#
    )
}
