//! Series of VTK's grids, small, as their programs write them.

use base64::{Engine, engine::general_purpose::STANDARD};
use std::io::Write;

/// How the numbers of a file are stored: text, base64, base64 and deflated, appended and deflated.
pub const WAYS: [&str; 4] = ["ascii", "binary", "deflated", "appended"];

/// Bytes of a block that is deflated.
const BLOCK: usize = 32;

/// Length and bytes, or the deflated blocks with their lengths, as far as they are encoded together.
fn stored(bytes: &[u8], deflated: bool) -> [Vec<u8>; 2] {
    let words = |w: &[usize]| w.iter().flat_map(|w| (*w as u32).to_le_bytes()).collect::<Vec<u8>>();
    if !deflated {
        return [[&words(&[bytes.len()]), bytes].concat(), vec![]];
    }
    let deflate = |block: &[u8]| {
        let mut deflated = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        deflated.write_all(block).unwrap();
        deflated.finish().unwrap()
    };
    let blocks: Vec<Vec<u8>> = bytes.chunks(BLOCK).map(deflate).collect();
    let sizes: Vec<usize> = blocks.iter().map(Vec::len).collect();
    [words(&[&[blocks.len(), BLOCK, bytes.len() % BLOCK], &sizes[..]].concat()), blocks.concat()]
}

/// A frame of `records::square`, with a velocity of three components, and in text a vertex and a line among its cells.
pub fn frame(square: &[(&str, Vec<usize>, Vec<f64>)], frame: usize, way: &str) -> Vec<u8> {
    let of = |name: &str| {
        let (_, shape, values) = square.iter().find(|a| a.0 == name).unwrap();
        let n = shape[1] * shape[2];
        values[if shape[0] > 1 { frame * n..(frame + 1) * n } else { 0..n }].to_vec()
    };
    let (deflated, mut appended) = (["deflated", "appended"].contains(&way), Vec::new());
    let mut array = |kind: &str, name: &str, components: usize, values: &[f64]| {
        let bytes = values.iter().flat_map(|v| match kind {
            "Float32" => (*v as f32).to_le_bytes().to_vec(),
            "UInt8" => vec![*v as u8],
            "Int64" => (*v as i64).to_le_bytes().to_vec(),
            _ => v.to_le_bytes().to_vec(),
        });
        let [head, rest] = stored(&bytes.collect::<Vec<u8>>(), deflated);
        let (format, offset, text) = match way {
            "ascii" => ("ascii", String::new(), values.iter().map(|v| format!("{v} ")).collect()),
            "appended" => ("appended", format!(" offset=\"{}\"", appended.len()), String::new()),
            _ => ("binary", String::new(), STANDARD.encode(&head) + &STANDARD.encode(&rest)),
        };
        appended.extend([head, rest].concat());
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"{format}\"{offset}>\n{text}\n\
             <InformationKey name=\"L2_NORM_RANGE\"/></DataArray>\n"
        )
    };
    let solid =
        |rows: Vec<f64>| rows.as_chunks::<2>().0.iter().flat_map(|[x, y]| [*x, *y, 0.0]).collect::<Vec<_>>();
    let (mut points, mut ends, mut kinds) = (of("cells"), vec![3.0, 6.0, 9.0, 12.0], vec![5.0; 4]);
    if way == "ascii" {
        points.splice(0..0, [0.0, 0.0, 1.0]);
        ends = [1.0, 3.0].into_iter().chain(ends.iter().map(|e| e + 3.0)).collect();
        kinds.splice(0..0, [1.0, 3.0]);
    }
    let text = [
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\"",
        if deflated { " compressor=\"vtkZLibDataCompressor\"" } else { "" },
        &format!("><UnstructuredGrid><Piece NumberOfPoints=\"5\" NumberOfCells=\"{}\">\n<PointData>\n", kinds.len()),
        &array("Float32", "velocity", 3, &solid(of("velocity"))),
        &array("Float64", "pressure", 1, &of("pressure")),
        &array("Int64", "node_type", 1, &of("node_type")),
        "</PointData><CellData>",
        &array("String", "unread", 1, &[]),
        "</CellData>\n<Points>\n",
        &array("Float64", "Points", 3, &solid(of("mesh_pos"))),
        "</Points>\n<Cells>\n",
        &array("Int64", "connectivity", 1, &points),
        &array("Int64", "offsets", 1, &ends),
        &array("UInt8", "types", 1, &kinds),
        "</Cells></Piece></UnstructuredGrid>\n",
    ]
    .concat();
    match way {
        "appended" => [
            text.as_bytes(),
            b"<AppendedData encoding=\"raw\">\n  _",
            &appended,
            b"\n</AppendedData></VTKFile>",
        ]
        .concat(),
        _ => (text + "</VTKFile>\n").into_bytes(),
    }
}
