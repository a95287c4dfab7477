//! Wavefront OBJ: the vertices and faces of a mesh, read line by line.
//!
//! Format: Wavefront *Object Files (.obj)*, version 3.0, `v` and `f` statements. Texture coordinates,
//! normals, groups, materials, points and lines have no meaning for a radar and are ignored. Free-form
//! surfaces and keywords that OBJ does not define are errors, because ignoring them would change the mesh.

use std::{
    io::{BufRead, BufReader, Read},
    path::Path,
};

use glam::DVec3;
use radarllm_files::bounded;
use radarllm_radar_sim::shapes::RigidSurface;

/// Maximum line length, continuation lines included, bytes: a polygon of some thousand corners.
const MAX_LINE: u64 = 1 << 16;
/// Maximum distance of a vertex from the mesh's origin, m. Files in millimetres exceed it intentionally.
const MAX_COORDINATE_M: f64 = 1000.0;
/// Statements that are ignored.
const PASSED_OVER: [&str; 21] = [
    "vt",
    "vn",
    "vp",
    "p",
    "l",
    "g",
    "s",
    "mg",
    "o",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "usemap",
    "maplib",
    "usemtl",
    "mtllib",
    "shadow_obj",
    "trace_obj",
    "ctech",
    "stech",
];

/// Reads a mesh of no more than `max_facets` triangles. Polygons are divided into triangle fans, which is correct for
/// convex ones. Faces may refer to later vertices, and may count backwards with negative numbers.
///
/// Memory: 24 bytes per vertex and 12 bytes per triangle. No number in the file determines the size of an allocation.
///
/// # Errors
/// File, line and the expected content.
pub(crate) fn read_obj(path: &Path, max_facets: usize) -> Result<RigidSurface, String> {
    let file = bounded::open(path).map_err(|e| e.to_string())?;
    parse(BufReader::with_capacity(1 << 18, file), max_facets)
        .map_err(|problem| format!("{}: {problem}", path.display()))
}

fn parse(mut reader: impl BufRead, max_facets: usize) -> Result<RigidSurface, String> {
    let (mut vertices, mut triangles): (Vec<DVec3>, Vec<[u32; 3]>) = (Vec::new(), Vec::new());
    let mut line = Vec::new();
    let mut corners = Vec::new();
    let mut line_no = 0;
    // The largest vertex number of a face, and its position in the file.
    let mut largest = (0, 0);
    while next_statement(&mut reader, &mut line, &mut line_no)? {
        let fail = |problem: String| format!("line {line_no}: {problem}");
        let text = line.split(|b| *b == b'#').next().unwrap_or_default();
        let text = std::str::from_utf8(text).map_err(|_| fail("not text".into()))?;
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            None => {}
            Some("v") => {
                if vertices.len() >= 3 * max_facets {
                    return Err(fail(format!("more than {} vertices", 3 * max_facets)));
                }
                vertices.push(vertex(words).map_err(fail)?);
            }
            Some("f") => {
                corners.clear();
                for word in words {
                    corners.push(corner(word, vertices.len()).map_err(fail)?);
                }
                if corners.len() < 3 {
                    let n = corners.len();
                    return Err(fail(format!("a face of {n} vertices, expected 3 or more")));
                }
                if triangles.len() + corners.len() - 2 > max_facets {
                    return Err(fail(format!(
                        "more than {max_facets} triangles; a radar sees no detail under a \
                         millimetre: reduce the mesh to edges of a few millimetres"
                    )));
                }
                for &index in &corners {
                    if index > largest.0 {
                        largest = (index, line_no);
                    }
                }
                let fan = corners.windows(2).skip(1);
                triangles.extend(fan.map(|pair| [corners[0], pair[0], pair[1]]));
            }
            Some(word) if PASSED_OVER.contains(&word) => {}
            Some(word) => {
                let shown: String = word.chars().take(40).collect();
                return Err(fail(format!(
                    "`{shown}` is not understood; vertices and polygons are (export free-form \
                     surfaces as triangles)"
                )));
            }
        }
    }
    if triangles.is_empty() {
        return Err("no face, so nothing to see".into());
    }
    let (index, at_line) = largest;
    if index as usize >= vertices.len() {
        return Err(format!(
            "line {at_line}: a face names vertex {}, of {} in the file",
            u64::from(index) + 1,
            vertices.len()
        ));
    }
    Ok(RigidSurface::new(vertices, triangles))
}

/// Reads a line and its continuation lines after a backslash; `false` at the end of the file.
fn next_statement(
    reader: &mut impl BufRead,
    line: &mut Vec<u8>,
    line_no: &mut usize,
) -> Result<bool, String> {
    line.clear();
    loop {
        let room = MAX_LINE - line.len() as u64;
        let n = reader
            .by_ref()
            .take(room)
            .read_until(b'\n', line)
            .map_err(|e| format!("after line {line_no}: {e}"))?;
        if n == 0 {
            return Ok(!line.is_empty());
        }
        *line_no += 1;
        if !line.ends_with(b"\n") && line.len() as u64 == MAX_LINE {
            return Err(format!("line {line_no}: longer than {MAX_LINE} bytes"));
        }
        let text_len = line.trim_ascii_end().len();
        if !line[..text_len].ends_with(b"\\") {
            return Ok(true);
        }
        line.truncate(text_len - 1);
        line.push(b' ');
    }
}

/// Three coordinates; a weight or a colour after them is ignored.
fn vertex<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<DVec3, String> {
    let mut at = [0.0_f64; 3];
    for value in &mut at {
        let word = words.next().ok_or("a vertex needs three coordinates")?;
        *value = word.parse().map_err(|_| {
            let shown: String = word.chars().take(40).collect();
            format!("`{shown}` is not a coordinate")
        })?;
        if !value.is_finite() || value.abs() > MAX_COORDINATE_M {
            return Err(format!(
                "coordinate {value}, expected metres within {MAX_COORDINATE_M} of the origin"
            ));
        }
    }
    Ok(DVec3::from_array(at))
}

/// A face's corner, `v`, `v/vt`, `v//vn` or `v/vt/vn`, as an index from 0.
fn corner(word: &str, n_vertices: usize) -> Result<u32, String> {
    let number = word.split('/').next().unwrap_or_default();
    let fail = || {
        let shown: String = word.chars().take(40).collect();
        format!("a face names vertex `{shown}`, of {n_vertices} before this line")
    };
    let number: i64 = number.parse().map_err(|_| fail())?;
    // Negative numbers count back from the last vertex so far.
    let index = match number {
        1.. => number - 1,
        0 => return Err(fail()),
        _ => n_vertices as i64 + number,
    };
    u32::try_from(index).map_err(|_| fail())
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::MovingSurface;

    const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\n";

    fn read(text: &str) -> Result<RigidSurface, String> {
        parse(text.as_bytes(), 1000)
    }

    #[test]
    fn polygons_and_all_ways_of_naming_vertices() {
        let same = [[0, 1, 2], [0, 2, 3]];
        for faces in [
            "f 1 2 3 4",
            "f 1/1 2/2 3/3 4/4\n",
            "f 1//1 2//1 3//1 4//1",
            "f 1/7/9 2/1/1 3/1/1 4/1/1 # a comment",
            "f -4 -3 -2 -1",
            "f 1 2 \\\n 3 \\\r\n 4\r\n",
            "o quad\ng side\ns off\nusemtl tin\nvn 0 1 0\nvt 0 0\nl 1 2\n\n\tf\t1  2 3 4",
        ] {
            let mesh = read(&format!("{QUAD}{faces}")).unwrap();
            assert_eq!(mesh.triangles(), same, "{faces}");
            assert_eq!(mesh.n_vertices(), 4);
        }
        // Faces may come first; colours and weights may follow coordinates.
        let mesh = read("f 1 2 3\nv 0 0 0 1.0\nv 1 0 0 0.1 0.2 0.3\nv 0 0 1\n").unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2]]);
        // A fan of ten.
        let circle: String = (0..12).map(|i| format!("v {i} 0 0\n")).collect();
        let face: String = (1..=12).map(|i| format!(" {i}")).collect();
        let mesh = read(&format!("{circle}f{face}")).unwrap();
        assert_eq!(mesh.triangles().len(), 10);
        // Without area: kept, for the simulator counts them.
        assert_eq!(read("v 0 0 0\nf 1 1 1").unwrap().triangles().len(), 1);
    }

    #[test]
    fn hostile_files_are_refused_with_their_line() {
        let long = format!("{QUAD}f{}", " 1".repeat(40_000));
        let continued = format!("{QUAD}f{}", " 1 \\\n".repeat(20_000));
        let many = format!("{QUAD}{}", "f 1 2 3 4\n".repeat(501));
        let vertices = "v 0 0 0\n".repeat(3001);
        let binary = "\u{0}\u{1}\u{2}".repeat(100);
        for (text, line, word) in [
            ("", "", "no face"),
            (QUAD, "", "no face"),
            ("v 0 0\n", "line 1:", "three coordinates"),
            ("v 0 0 x\n", "line 1:", "`x`"),
            ("v 0 0 0\nv 0 0 nan\n", "line 2:", "NaN"),
            ("v 0 inf 0\n", "line 1:", "inf"),
            ("v 0 0 1e999\n", "line 1:", "inf"),
            ("v 0 0 1700\n", "line 1:", "metres"),
            ("v 0 0 0\nf 1 1\n", "line 2:", "2 vertices"),
            ("v 0 0 0\nf\n", "line 2:", "0 vertices"),
            ("v 0 0 0\nf 1 1 0\n", "line 2:", "`0`"),
            ("v 0 0 0\nf 1 1 -2\n", "line 2:", "`-2`"),
            ("v 0 0 0\nf 1 1 2\nf 1 1 1\n", "line 2:", "vertex 2, of 1"),
            ("v 0 0 0\nf 1 1 4294967296\n", "line 2:", "4294967296"),
            ("v 0 0 0\nf 1 1 4294967297\n", "line 2:", "4294967297"),
            ("f 1 1 99999999999999999999999\n", "line 1:", "999"),
            ("f 1 1 -9223372036854775808\n", "line 1:", "-922"),
            ("f /1 /1 /1\n", "line 1:", "`/1`"),
            ("f 1 2 x\n", "line 1:", "`x`"),
            ("surf 0 1 0 1 1 2 3\n", "line 1:", "`surf`"),
            (&binary, "line 1:", "not understood"),
            (&long, "line 5:", "longer"),
            (&continued, "line", "longer"),
            (&many, "line 505:", "more than 1000 triangles"),
            (&vertices, "line 3001:", "more than 3000 vertices"),
        ] {
            let error = read(text).map(|_| ()).unwrap_err();
            let shown: String = text.chars().take(60).collect();
            assert!(
                error.contains(line) && error.contains(word) && error.len() < 300,
                "`{shown}`: {error}"
            );
        }
        let error = parse(&b"v 0 0 0\n\xff\xfe\n"[..], 10)
            .map(|_| ())
            .unwrap_err();
        assert!(error.contains("line 2: not text"), "{error}");
    }
    /// Bytes are changed, duplicated and deleted at random. Every input must give a result, and no result may contain
    /// an index that is out of range in the simulator.
    #[test]
    fn damaged_files_never_panic() {
        use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
        let good = format!("o a\n{QUAD}vn 0 1 0\nf 1//1 2//1 -2//1\nf 1 3 \\\n4\n");
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut n_read = 0;
        for _ in 0..20_000 {
            let mut bytes = good.clone().into_bytes();
            for _ in 0..rng.random_range(1..6) {
                let at = rng.random_range(0..bytes.len());
                match rng.random_range(0..4) {
                    0 => bytes[at] = rng.random_range(0..=255),
                    1 => bytes[at] = b"0123456789-/.\\\n evf#"[rng.random_range(0..20)],
                    2 => bytes.insert(at, bytes[at]),
                    _ if bytes.len() > 1 => drop(bytes.remove(at)),
                    _ => {}
                }
            }
            if let Ok(mesh) = parse(bytes.as_slice(), 1000) {
                n_read += 1;
                let n = mesh.n_vertices();
                assert!(mesh.triangles().iter().flatten().all(|i| (*i as usize) < n));
            }
        }
        assert!(n_read > 100, "some damage does not matter: {n_read}");
    }
}
