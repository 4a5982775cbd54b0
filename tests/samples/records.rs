//! Files of others, small, as their programs write them.
// Each test program uses a part of it.
#![allow(dead_code)]

use serde_json::{Value, json};

/// A unit square of four triangles around its middle, in three frames 0.5 s apart: names, shapes and values.
pub fn square() -> Vec<(&'static str, Vec<usize>, Vec<f64>)> {
    let velocity = (0..3 * 5 * 2).map(|i| 0.125 * f64::from(i)).collect();
    let pressure = (0..3 * 5).map(|i| 0.25 * f64::from(i) - 1.0).collect();
    vec![
        ("cells", vec![1, 4, 3], vec![0., 1., 4., 1., 2., 4., 2., 3., 4., 3., 0., 4.]),
        ("mesh_pos", vec![1, 5, 2], vec![0., 0., 1., 0., 1., 1., 0., 1., 0.5, 0.5]),
        ("node_type", vec![1, 5, 1], vec![4., 6., 5., 6., 0.]),
        ("pressure", vec![3, 5, 1], pressure),
        ("velocity", vec![3, 5, 2], velocity),
    ]
}

/// A body of two tetrahedra on three held points, and one tetrahedron above that comes down, in three frames.
pub fn plate() -> Vec<(&'static str, Vec<usize>, Vec<f64>)> {
    let rest = [
        [0., 0., 0.],
        [1., 0., 0.],
        [0., 1., 0.],
        [0.25, 0.25, 1.],
        [1., 1., 1.],
        [0., 0., 2.],
        [1., 0., 2.],
        [0., 1., 2.],
        [0., 0., 3.],
    ];
    let at = |frame: usize, p: usize| match p {
        0..3 => rest[p],
        3 | 4 => [rest[p][0], rest[p][1], rest[p][2] - 0.125 * frame as f64],
        _ => [rest[p][0] + 0.5 * frame as f64, rest[p][1], rest[p][2] - 0.25 * frame as f64],
    };
    let world = (0..3).flat_map(|frame| (0..9).flat_map(move |p| at(frame, p)));
    vec![
        // The second one is turned inside out.
        ("cells", vec![1, 3, 4], vec![0., 1., 2., 3., 1., 3., 2., 4., 5., 6., 7., 8.]),
        ("mesh_pos", vec![1, 9, 3], rest.concat()),
        ("node_type", vec![1, 9, 1], vec![3., 3., 3., 0., 0., 1., 1., 1., 1.]),
        ("stress", vec![3, 9, 1], (0..27).map(|i| if i % 9 < 5 { f64::from(i) } else { 0.0 }).collect()),
        ("world_pos", vec![3, 9, 3], world.collect()),
    ]
}

pub fn is_whole(name: &str) -> bool {
    ["cells", "node_type"].contains(&name)
}

fn raw(name: &str, values: &[f64]) -> Vec<u8> {
    match is_whole(name) {
        true => values.iter().flat_map(|v| (*v as i32).to_le_bytes()).collect(),
        false => values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect(),
    }
}

/// `meta.json` of [`square`].
pub fn meta() -> Value {
    meta_of(&square(), 0.5)
}

/// `meta.json` of arrays.
pub fn meta_of(arrays: &[(&str, Vec<usize>, Vec<f64>)], dt: f64) -> Value {
    let mut features = json!({});
    for (name, shape, _) in arrays {
        let dynamic = shape[0] > 1;
        features[*name] = json!({
            "type": if dynamic { "dynamic" } else { "static" },
            "shape": [shape[0], -1, shape[2]],
            "dtype": if is_whole(name) { "int32" } else { "float32" },
        });
    }
    json!({ "simulator": "comsol", "dt": dt, "collision_radius": null, "trajectory_length": 3, "features": features })
}

/// A field of protobuf that has a length.
fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
    let (mut field, mut n) = (vec![number << 3 | 2], bytes.len());
    while n > 127 {
        field.push(n as u8 | 128);
        n >>= 7;
    }
    field.push(n as u8);
    [field, bytes.to_vec()].concat()
}

/// A `tf.train.Example` of [`square`].
pub fn example() -> Vec<u8> {
    example_of(&square())
}

/// A `tf.train.Example` of arrays.
pub fn example_of(arrays: &[(&str, Vec<usize>, Vec<f64>)]) -> Vec<u8> {
    let entry = |(name, _, values): &(&str, Vec<usize>, Vec<f64>)| {
        let list = field(1, &raw(name, values));
        field(1, &[field(1, name.as_bytes()), field(2, &field(1, &list))].concat())
    };
    field(1, &arrays.iter().flat_map(entry).collect::<Vec<u8>>())
}

/// A record around these bytes.
pub fn record(bytes: &[u8]) -> Vec<u8> {
    let masked =
        |bytes: &[u8]| crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes();
    let length = (bytes.len() as u64).to_le_bytes();
    [&length[..], &masked(&length), bytes, &masked(bytes)].concat()
}

/// The files of what `torch.save` writes of a state dict: names, shapes and values.
pub fn state_dict(tensors: &[(&str, Vec<usize>, Vec<f32>)]) -> Vec<(String, Vec<u8>)> {
    let text = |t: &str| [&[b'X'][..], &(t.len() as u32).to_le_bytes(), t.as_bytes()].concat();
    let whole = |n: usize| [&[b'J'][..], &(n as u32).to_le_bytes()].concat();
    let tuple = |parts: Vec<Vec<u8>>| [&b"("[..], &parts.concat(), b"t"].concat();
    let dict = b"ccollections\nOrderedDict\n)R".to_vec();
    let mut pickle = [&b"\x80\x02"[..], &dict, b"q\x01("].concat();
    for (key, (name, shape, values)) in tensors.iter().enumerate() {
        let kind = b"ctorch\nFloatStorage\n".to_vec();
        let storage = [text("storage"), kind, text(&key.to_string()), text("cpu"), whole(values.len())];
        let strides = (0..shape.len()).map(|d| whole(shape[d + 1..].iter().product()));
        let tensor = tuple(vec![
            [tuple(storage.into()), b"Q".to_vec()].concat(),
            whole(0),
            tuple(shape.iter().map(|n| whole(*n)).collect()),
            tuple(strides.collect()),
            b"\x89".to_vec(),
            dict.clone(),
        ]);
        pickle.extend(
            [text(name), b"ctorch._utils\n_rebuild_tensor_v2\n".to_vec(), tensor, b"R".to_vec()].concat(),
        );
    }
    pickle.extend(b"u.");
    let numbers = tensors.iter().map(|t| t.2.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    let files = numbers.enumerate().map(|(key, bytes)| (format!("w/data/{key}"), bytes));
    std::iter::once(("w/data.pkl".to_string(), pickle)).chain(files).collect()
}

/// A zip archive of files as they are.
pub fn zip(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut archive = rawzip::ZipArchiveWriter::new(&mut bytes);
    for (name, content) in files {
        let file = archive.new_file(name).compression_method(rawzip::CompressionMethod::STORE);
        let (mut entry, config) = file.start().unwrap();
        let mut writer = config.wrap(&mut entry);
        std::io::Write::write_all(&mut writer, content).unwrap();
        let (_, descriptor) = writer.finish().unwrap();
        entry.finish(descriptor).unwrap();
    }
    archive.finish().unwrap();
    bytes
}
