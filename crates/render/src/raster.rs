//! A small software rasteriser: renders shaded meshes, a floor grid and stick figures to PNG.
//!
//! World axes are z up, in metres. [`Scene`] collects the objects to draw; [`render_mesh`] draws a single mesh. Images
//! are 8-bit sRGB.

use glam::{Mat4, Vec3, Vec4};

use crate::PngError;
use crate::png_file::{self, Pixels};

/// Samples per pixel along each axis.
const SUPERSAMPLING: usize = 2;
const BACKGROUND: Vec3 = Vec3::new(0.93, 0.94, 0.96);
const FLOOR_LINE: Vec3 = Vec3::new(0.55, 0.58, 0.62);
const SKIN: Vec3 = Vec3::new(0.80, 0.62, 0.50);
const STICK: Vec3 = Vec3::new(0.10, 0.35, 0.75);

/// Draws one mesh on a floor grid.
///
/// ```
/// use glam::Vec3;
/// use radarllm_render::raster::{Camera, render_mesh};
///
/// let corners = [Vec3::ZERO, Vec3::X, Vec3::Z];
/// let camera = Camera::orbit(Vec3::Z, 4.0, 0.3, 0.1);
/// let image = render_mesh(&corners, &[[0, 1, 2]], &camera, [64, 48]);
/// assert!(image.to_png()?.starts_with(b"\x89PNG"));
/// # Ok::<(), radarllm_render::raster::ImageError>(())
/// ```
///
/// `vertices` are in world axes, m; `triangles` index them counter-clockwise seen from outside. Triangles with an index
/// out of range are omitted.
pub fn render_mesh(
    vertices: &[Vec3],
    triangles: &[[u32; 3]],
    camera: &Camera,
    size: [usize; 2],
) -> Image {
    let mut scene = Scene::new(camera, size);
    scene.floor_grid(5.0, 0.5);
    scene.mesh(vertices, triangles, SKIN, Shading::Smooth);
    scene.finish()
}

/// Draws frames of a moving mesh side by side and returns a PNG file, with at most four frames per row. The camera
/// follows the body sideways in each frame; the scale is the same in all frames, and the floor grid is stationary.
///
/// `frames` hold vertices in world axes, m. The viewer is in front of a person who faces -y, 0.6 rad to the left of the
/// person.
pub fn contact_sheet(frames: &[Vec<Vec3>], triangles: &[[u32; 3]]) -> Result<Vec<u8>, ImageError> {
    const CELL: [usize; 2] = [360, 400];
    let bounds = |vertices: &[Vec3]| {
        let finite = vertices.iter().filter(|v| v.is_finite());
        finite.fold(None, |b: Option<(Vec3, Vec3)>, v| match b {
            None => Some((*v, *v)),
            Some((low, high)) => Some((low.min(*v), high.max(*v))),
        })
    };
    let boxes: Vec<(Vec3, Vec3)> = frames
        .iter()
        .map(|f| bounds(f).unwrap_or_default())
        .collect();
    let top_m = boxes.iter().map(|b| b.1.z).fold(1.0, f32::max).min(20.0);
    let width_m = boxes
        .iter()
        .map(|b| (b.1 - b.0).truncate().length())
        .fold(1.0, f32::max)
        .min(20.0);
    // A camera with a field of view of 0.6 rad sees tan(0.3) of its distance on each side of the axis. A margin is left
    // around the larger extent.
    let distance_m = 0.65 * top_m.max(width_m) / 0.3f32.tan() + 0.5 * width_m.min(1.0);
    let images: Vec<Image> = frames
        .iter()
        .zip(&boxes)
        .map(|(vertices, (low, high))| {
            let middle = (0.5 * (*low + *high)).truncate().extend(0.5 * top_m);
            let camera = Camera::orbit(middle, distance_m, 0.6, 0.12);
            render_mesh(vertices, triangles, &camera, CELL)
        })
        .collect();
    Image::contact_sheet(&images, 4).to_png()
}

/// A perspective camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye, m.
    pub eye_m: Vec3,
    /// Point at the centre of the image, m.
    pub target_m: Vec3,
    /// Vertical field of view, rad.
    pub field_of_view_rad: f32,
}

impl Camera {
    /// Looks at `target_m` from a distance, at an elevation and an azimuth that is counter-clockwise from -y seen from
    /// above (0 is in front of a person who faces -y, pi/2 is at +x).
    pub fn orbit(target_m: Vec3, distance_m: f32, azimuth_rad: f32, elevation_rad: f32) -> Self {
        let (sin_a, cos_a) = azimuth_rad.sin_cos();
        let (sin_e, cos_e) = elevation_rad.sin_cos();
        let eye_m = target_m + distance_m * Vec3::new(sin_a * cos_e, -cos_a * cos_e, sin_e);
        Self {
            eye_m,
            target_m,
            field_of_view_rad: 0.6,
        }
    }

    /// Clip-space matrix for a ratio of width to height.
    fn clip_from_world(&self, aspect: f32) -> Mat4 {
        let forward = (self.target_m - self.eye_m).normalize_or(Vec3::Y);
        let up = if forward.z.abs() > 0.99 {
            Vec3::Y
        } else {
            Vec3::Z
        };
        let right = forward.cross(up).normalize();
        let up = right.cross(forward);
        let focal = 1.0 / (0.5 * self.field_of_view_rad).tan();
        let (x, y) = (right * (focal / aspect), up * focal);
        // Depth is z / w = far (d - near) / (d (far - near)) at the distance d along the viewing direction.
        let z = forward * (FAR_M / (FAR_M - NEAR_M));
        let row = |axis: Vec3, shift: f32| axis.extend(shift - axis.dot(self.eye_m));
        let rows = [
            row(x, 0.0),
            row(y, 0.0),
            row(z, -NEAR_M * FAR_M / (FAR_M - NEAR_M)),
            row(forward, 0.0),
        ];
        Mat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose()
    }
}

/// Distance of the near plane, m.
const NEAR_M: f32 = 0.05;
/// Distance of the far plane, m.
const FAR_M: f32 = 100.0;

/// Shading of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shading {
    /// Constant brightness per facet, which shows the triangles.
    Flat,
    /// Normals interpolated between vertices.
    Smooth,
}

/// An 8-bit RGB image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    width: usize,
    height: usize,
    /// Rows from the top, three bytes per pixel.
    rgb: Vec<u8>,
}

/// An image could not be encoded.
#[derive(Debug, thiserror::Error)]
#[error("png of {width} x {height} pixels: {source}")]
pub struct ImageError {
    width: usize,
    height: usize,
    source: PngError,
}

impl Image {
    /// An image of one colour.
    pub fn filled(width: usize, height: usize, rgb: [u8; 3]) -> Self {
        Self {
            width,
            height,
            rgb: rgb.repeat(width * height),
        }
    }

    /// Pixels of a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Rows from the top, three bytes per pixel.
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// Colour of a pixel; `None` outside the image.
    pub fn pixel(&self, x: usize, y: usize) -> Option<[u8; 3]> {
        if x >= self.width || y >= self.height {
            return None;
        }
        let at = (y * self.width + x) * 3;
        Some([self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]])
    }

    /// The image as a PNG file.
    ///
    /// # Errors
    /// An image without pixels.
    pub fn to_png(&self) -> Result<Vec<u8>, ImageError> {
        let (width, height) = (self.width, self.height);
        png_file::encode(width, height, &Pixels::Rgb(&self.rgb), &[]).map_err(|source| ImageError {
            width,
            height,
            source,
        })
    }

    /// The image as a `data:` URI, for `<image href="...">` in SVG and HTML.
    ///
    /// # Errors
    /// An image without pixels.
    pub fn to_data_uri(&self) -> Result<String, ImageError> {
        Ok(png_file::data_uri(&self.to_png()?))
    }

    /// Arranges images in rows of `n_columns`, two pixels apart, in cells of the size of the largest image.
    pub fn contact_sheet(images: &[Image], n_columns: usize) -> Image {
        const GAP: usize = 2;
        let n_columns = n_columns.clamp(1, images.len().max(1));
        let n_rows = images.len().div_ceil(n_columns);
        let cell_width = images.iter().map(|i| i.width).max().unwrap_or(0);
        let cell_height = images.iter().map(|i| i.height).max().unwrap_or(0);
        let width = n_columns * cell_width + (n_columns - 1) * GAP;
        let height = n_rows * cell_height + n_rows.saturating_sub(1) * GAP;
        let mut sheet = Image::filled(width, height, [255; 3]);
        for (i, image) in images.iter().enumerate() {
            let (left, top) = (
                i % n_columns * (cell_width + GAP),
                i / n_columns * (cell_height + GAP),
            );
            for y in 0..image.height {
                let to = ((top + y) * width + left) * 3;
                let from = y * image.width * 3;
                sheet.rgb[to..to + image.width * 3]
                    .copy_from_slice(&image.rgb[from..from + image.width * 3]);
            }
        }
        sheet
    }
}

/// An image under construction, with colour and depth buffers.
pub struct Scene {
    /// Size in samples.
    width: usize,
    height: usize,
    clip_from_world: Mat4,
    eye_m: Vec3,
    color: Vec<Vec3>,
    /// Depth in clip space, 0 near to 1 far.
    depth: Vec<f32>,
}

/// A vertex in clip space.
#[derive(Clone, Copy)]
struct Corner {
    clip: Vec4,
    shade: f32,
}

impl Scene {
    /// An empty scene of `[width, height]` pixels.
    pub fn new(camera: &Camera, size: [usize; 2]) -> Self {
        let (width, height) = (
            size[0].max(1) * SUPERSAMPLING,
            size[1].max(1) * SUPERSAMPLING,
        );
        Self {
            width,
            height,
            clip_from_world: camera.clip_from_world(width as f32 / height as f32),
            eye_m: camera.eye_m,
            color: vec![BACKGROUND; width * height],
            depth: vec![1.0; width * height],
        }
    }

    /// Draws a square grid of lines on z = 0 from -`half_size_m` to +`half_size_m`.
    pub fn floor_grid(&mut self, half_size_m: f32, spacing_m: f32) {
        if !(spacing_m > 0.0 && half_size_m / spacing_m < 1000.0) {
            return;
        }
        let n = (half_size_m / spacing_m).floor() as i32;
        let reach = n as f32 * spacing_m;
        for i in -n..=n {
            let at = i as f32 * spacing_m;
            self.line(
                Vec3::new(at, -reach, 0.0),
                Vec3::new(at, reach, 0.0),
                FLOOR_LINE,
                0.0,
            );
            self.line(
                Vec3::new(-reach, at, 0.0),
                Vec3::new(reach, at, 0.0),
                FLOOR_LINE,
                0.0,
            );
        }
    }

    /// Draws a triangle mesh with colours of 0..=1 per channel. Back faces are darkened and blue, so that wrongly
    /// oriented triangles are visible.
    pub fn mesh(
        &mut self,
        vertices: &[Vec3],
        triangles: &[[u32; 3]],
        color: Vec3,
        shading: Shading,
    ) {
        let is_valid = |t: &[u32; 3]| t.iter().all(|&v| (v as usize) < vertices.len());
        let at = |v: u32| vertices[v as usize];
        let face_normal = |t: &[u32; 3]| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0]));
        let mut normals = vec![
            Vec3::ZERO;
            if shading == Shading::Smooth {
                vertices.len()
            } else {
                0
            }
        ];
        if shading == Shading::Smooth {
            for t in triangles.iter().filter(|t| is_valid(t)) {
                let normal = face_normal(t);
                t.iter().for_each(|&v| normals[v as usize] += normal);
            }
        }
        for t in triangles.iter().filter(|t| is_valid(t)) {
            let face = face_normal(t);
            let is_back = face.dot(self.eye_m - at(t[0])) < 0.0;
            let corners = t.map(|v| Corner {
                clip: self.clip_from_world * at(v).extend(1.0),
                shade: match shading {
                    Shading::Flat => self.lambert(face, at(v)),
                    Shading::Smooth => self.lambert(normals[v as usize], at(v)),
                },
            });
            let tint = if is_back {
                Vec3::new(0.2, 0.2, 0.6)
            } else {
                color
            };
            self.triangle(corners, tint);
        }
    }

    /// Draws a stick figure over everything else: lines from `parents[i]` to joint i.
    pub fn skeleton(&mut self, joints: &[Vec3], parents: &[Option<usize>]) {
        for (joint, parent) in joints.iter().zip(parents) {
            if let Some(from) = parent.and_then(|p| joints.get(p)) {
                self.line(*from, *joint, STICK, 1.0);
            }
        }
    }

    /// Averages the samples of each pixel and returns the image.
    pub fn finish(self) -> Image {
        let (width, height) = (self.width / SUPERSAMPLING, self.height / SUPERSAMPLING);
        let mut rgb = Vec::with_capacity(width * height * 3);
        for y in 0..height {
            for x in 0..width {
                let mut sum = Vec3::ZERO;
                for sy in 0..SUPERSAMPLING {
                    for sx in 0..SUPERSAMPLING {
                        sum += self.color
                            [(y * SUPERSAMPLING + sy) * self.width + x * SUPERSAMPLING + sx];
                    }
                }
                let mean = sum / (SUPERSAMPLING * SUPERSAMPLING) as f32;
                rgb.extend(
                    mean.to_array()
                        .map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8),
                );
            }
        }
        Image { width, height, rgb }
    }

    /// Brightness from ambient light, a key light over the viewer's left shoulder and a weak light from above.
    fn lambert(&self, normal: Vec3, at: Vec3) -> f32 {
        let normal = normal.normalize_or_zero();
        let to_eye = (self.eye_m - at).normalize_or(Vec3::Z);
        let left = Vec3::Z.cross(-to_eye).normalize_or(Vec3::X);
        let key = (to_eye + 0.7 * left + 0.6 * Vec3::Z).normalize();
        0.22 + 0.68 * normal.dot(key).max(0.0) + 0.15 * normal.z.max(0.0)
    }

    /// Pixel coordinates and depth of a point in front of the camera.
    fn to_screen(&self, clip: Vec4) -> Vec3 {
        let ndc = clip.truncate() / clip.w;
        Vec3::new(
            (0.5 + 0.5 * ndc.x) * self.width as f32,
            (0.5 - 0.5 * ndc.y) * self.height as f32,
            ndc.z,
        )
    }

    fn triangle(&mut self, corners: [Corner; 3], color: Vec3) {
        // Triangles that cross the near plane are omitted rather than clipped, because the camera is normally far from
        // the mesh.
        if corners
            .iter()
            .any(|c| c.clip.w.is_nan() || c.clip.w <= NEAR_M)
        {
            return;
        }
        let [a, b, c] = corners.map(|k| self.to_screen(k.clip));
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let x_range = pixel_range(low.x, high.x, self.width);
        for y in pixel_range(low.y, high.y, self.height) {
            for x in x_range.clone() {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                let u = ((b.x - px) * (c.y - py) - (b.y - py) * (c.x - px)) / area;
                let v = ((c.x - px) * (a.y - py) - (c.y - py) * (a.x - px)) / area;
                let w = 1.0 - u - v;
                if u < 0.0 || v < 0.0 || w < 0.0 {
                    continue;
                }
                let depth = u * a.z + v * b.z + w * c.z;
                let shade = u * corners[0].shade + v * corners[1].shade + w * corners[2].shade;
                self.put(x, y, depth, color * shade);
            }
        }
    }

    fn put(&mut self, x: usize, y: usize, depth: f32, color: Vec3) {
        let at = y * self.width + x;
        if depth >= 0.0 && depth < self.depth[at] {
            self.depth[at] = depth;
            self.color[at] = color;
        }
    }

    /// Draws a line of `SUPERSAMPLING` samples width. `lift` in 0..=1 moves it towards the viewer; 1 draws it over
    /// everything else.
    fn line(&mut self, from: Vec3, to: Vec3, color: Vec3, lift: f32) {
        let (mut a, mut b) = (
            self.clip_from_world * from.extend(1.0),
            self.clip_from_world * to.extend(1.0),
        );
        if a.w < NEAR_M && b.w < NEAR_M {
            return;
        }
        if a.w < NEAR_M {
            a = a.lerp(b, (NEAR_M - a.w) / (b.w - a.w));
        } else if b.w < NEAR_M {
            b = b.lerp(a, (NEAR_M - b.w) / (a.w - b.w));
        }
        let (a, b) = (self.to_screen(a), self.to_screen(b));
        let n_steps = (b - a).truncate().abs().max_element().ceil();
        // A line much longer than the image belongs to a point close to the plane of the eye.
        if n_steps.is_nan() || n_steps > 64.0 * (self.width + self.height) as f32 {
            return;
        }
        for i in 0..=n_steps as usize {
            let p = a.lerp(b, i as f32 / n_steps.max(1.0));
            for y in pixel_range(p.y - 1.0, p.y, self.height) {
                for x in pixel_range(p.x - 1.0, p.x, self.width) {
                    self.put(x, y, p.z * (1.0 - lift), color);
                }
            }
        }
    }
}

/// Range of samples whose centres may lie between two coordinates.
fn pixel_range(low: f32, high: f32, size: usize) -> std::ops::Range<usize> {
    // Casts from float to integer saturate: negative values and NaN become zero.
    let first = low.floor().max(0.0) as usize;
    let last = (high.ceil().max(0.0) as usize).min(size);
    first.min(last)..last
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::png_file::tests::decoded;

    fn camera() -> Camera {
        Camera::orbit(Vec3::new(0.0, 0.0, 1.0), 4.0, 0.0, 0.0)
    }

    const SIZE: [usize; 2] = [81, 81];

    fn square(y: f32, half: f32) -> [Vec3; 4] {
        [
            Vec3::new(-half, y, 1.0 - half),
            Vec3::new(half, y, 1.0 - half),
            Vec3::new(half, y, 1.0 + half),
            Vec3::new(-half, y, 1.0 + half),
        ]
    }

    const FACES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

    #[test]
    fn a_square_covers_the_pixels_its_angle_says() {
        let mut scene = Scene::new(&camera(), SIZE);
        scene.mesh(&square(0.0, 0.5), &FACES, Vec3::ONE, Shading::Flat);
        let image = scene.finish();
        let background = Image::filled(
            1,
            1,
            BACKGROUND.to_array().map(|c| (c * 255.0).round() as u8),
        )
        .pixel(0, 0);
        let n_covered = (0..81)
            .filter(|&x| image.pixel(x, 40) != background)
            .count();
        // 1 m at 4 m with a field of view of 0.6 rad: 81 * 0.5 / (4 tan 0.3) = 32.7 pixels, +-1 for the edges.
        assert!((32..=34).contains(&n_covered), "{n_covered}");
    }

    #[test]
    fn the_nearer_surface_hides_the_farther_whatever_the_order() {
        let draw = |order: [usize; 2]| {
            let mut scene = Scene::new(&camera(), SIZE);
            for i in order {
                let (y, color) = [(0.0, Vec3::X), (-0.5, Vec3::Z)][i];
                scene.mesh(&square(y, 0.5), &FACES, color, Shading::Flat);
            }
            scene.finish().pixel(40, 40)
        };
        // The square at y = -0.5 is nearer to a viewer at y = -4.
        let [r, _, b] = draw([0, 1]).expect("inside the picture");
        assert!(b > r);
        assert_eq!(draw([0, 1]), draw([1, 0]));
    }

    #[test]
    fn left_of_a_person_facing_the_viewer_is_right_in_the_picture() {
        let mut scene = Scene::new(&camera(), SIZE);
        let moved = square(0.0, 0.1).map(|p| p + 0.5 * Vec3::X);
        scene.mesh(&moved, &FACES, Vec3::X, Shading::Flat);
        let image = scene.finish();
        // Seen from -y with z up, +x is to the right.
        assert_ne!(image.pixel(40 + 16, 40), image.pixel(40 - 16, 40));
        assert!(image.pixel(40 + 16, 40).is_some_and(|[r, g, _]| r > g));
    }

    #[test]
    fn wild_input_draws_nothing_and_does_not_panic() {
        let mut scene = Scene::new(&camera(), SIZE);
        let before = scene.color.clone();
        let wild = [
            Vec3::NAN,
            Vec3::INFINITY,
            Vec3::new(0.0, -4.0, 1.0),
            Vec3::new(1e30, 5.0, -1e30),
        ];
        scene.mesh(
            &wild,
            &[[0, 1, 2], [1, 2, 3], [0, 9, 1]],
            Vec3::X,
            Shading::Smooth,
        );
        scene.skeleton(&wild, &[None, Some(0), Some(1), Some(77)]);
        assert_eq!(scene.color, before);
    }

    #[test]
    fn a_png_reads_back_as_written() {
        let mut image = Image::filled(5, 3, [10, 20, 30]);
        image.rgb[3..6].copy_from_slice(&[200, 100, 50]);
        let bytes = image.to_png().expect("memory does not fail");
        let (_, _, rgb) = decoded(&bytes);
        assert_eq!(rgb.as_flattened(), image.rgb);
    }

    #[test]
    fn a_sheet_shows_every_frame_and_survives_empty_ones() {
        let frames = vec![
            square(0.0, 0.4).to_vec(),
            Vec::new(),
            square(3.0, 0.4).to_vec(),
        ];
        let png = contact_sheet(&frames, &FACES).expect("memory does not fail");
        let (width, height, rgb) = decoded(&png);
        assert_eq!((width, height), (3 * 360 + 4, 400));
        let pixel = |x: usize, y: usize| rgb[y * width + x];
        // The square extends from 0.6 to 1.4 m. The centre of the image is at 0.7 m, and the sample slightly above it
        // at 0.9 m.
        let is_skin = |p: [u8; 3]| p[0] > p[2].saturating_add(5);
        assert!(is_skin(pixel(180, 150)) && is_skin(pixel(2 * 362 + 180, 150)));
        assert!(!is_skin(pixel(362 + 180, 150)));
    }

    #[test]
    fn a_contact_sheet_keeps_the_order() {
        let images: Vec<Image> = (0..3).map(|i| Image::filled(4, 4, [i * 50; 3])).collect();
        let sheet = Image::contact_sheet(&images, 2);
        assert_eq!((sheet.width(), sheet.height()), (10, 10));
        assert_eq!(sheet.pixel(8, 0), Some([50; 3]));
        assert_eq!(sheet.pixel(0, 8), Some([100; 3]));
        assert_eq!(sheet.pixel(8, 8), Some([255; 3]));
    }
}
