//! What cannot be simulated is refused, and nothing makes a NaN.

use glam::{DVec3, Vec3};
use radarllm_base::{Material, MovingSurface, RadarConfig, RadarCube};
use radarllm_radar_sim::{Noise, PointTarget, Scene, SimError, SimOptions, Simulator};

/// Any mesh, at rest.
struct Mesh {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    material: Material,
}

impl Mesh {
    fn triangle(vertices: [Vec3; 3]) -> Self {
        Self {
            vertices: vertices.to_vec(),
            triangles: vec![[0, 1, 2]],
            material: Material::PEC,
        }
    }
}

impl MovingSurface for Mesh {
    fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }
    fn n_vertices(&self) -> usize {
        self.vertices.len()
    }
    fn positions_at(&self, _: f64, out: &mut [Vec3]) {
        out.copy_from_slice(&self.vertices);
    }
    fn material(&self) -> Material {
        self.material
    }
}

fn config() -> RadarConfig {
    RadarConfig {
        n_loops: 4,
        ..RadarConfig::awr1843boost()
    }
}

fn run(scene: &Scene<'_>) -> Result<RadarCube, SimError> {
    let mut simulator = Simulator::new(&config(), SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    simulator.simulate_frame(scene, 0, 0.0, 1, &mut cube)?;
    assert!(
        cube.data
            .iter()
            .all(|z| z.re.is_finite() && z.im.is_finite())
    );
    Ok(cube)
}

fn of(mesh: &Mesh) -> Scene<'_> {
    Scene {
        surfaces: vec![mesh],
        points: vec![],
        noise: Noise::Off,
    }
}

fn good() -> [Vec3; 3] {
    [
        Vec3::new(0.0, 2.0, 0.0),
        Vec3::new(0.1, 2.0, 0.0),
        Vec3::new(0.0, 2.0, 0.1),
    ]
}

#[test]
fn unusable_vertices_are_named() {
    for bad in [f32::NAN, f32::INFINITY, 1e30, 2000.0] {
        let mut mesh = Mesh::triangle(good());
        mesh.vertices[2].x = bad;
        let error = run(&of(&mesh)).unwrap_err();
        assert!(
            matches!(
                error,
                SimError::Position {
                    surface: 0,
                    vertex: 2,
                    ..
                }
            ),
            "{bad}: {error}"
        );
    }
    let mut mesh = Mesh::triangle(good());
    mesh.vertices[1] = Vec3::new(0.0, 0.02, 0.0);
    assert!(matches!(
        run(&of(&mesh)).unwrap_err(),
        SimError::TooClose {
            what: "surface",
            ..
        }
    ));
}

#[test]
fn triangles_without_area_scatter_nothing_and_are_counted() {
    let mut mesh = Mesh::triangle(good());
    mesh.triangles.extend([[0, 0, 1], [2, 2, 2]]);
    let mut simulator = Simulator::new(&config(), SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    let stats = simulator
        .simulate_frame(&of(&mesh), 0, 0.0, 1, &mut cube)
        .unwrap();
    assert_eq!(
        (stats.n_facets, stats.n_degenerate, stats.n_visible),
        (3, 2, 1)
    );
    assert_eq!(cube.data, run(&of(&Mesh::triangle(good()))).unwrap().data);
}

#[test]
fn indices_materials_points_and_ratios_are_checked() {
    let mut mesh = Mesh::triangle(good());
    mesh.triangles.push([0, 1, 3]);
    let error = run(&of(&mesh)).unwrap_err();
    assert_eq!(
        error,
        SimError::TriangleIndex {
            surface: 0,
            triangle: 1,
            vertex: 3,
            n_vertices: 3
        }
    );
    for (power_reflection, roughness_m, rough_albedo, power_transmission) in [
        (f32::NAN, 0.0, 0.0, 0.0),
        (1.1, 0.0, 0.0, 0.0),
        (1.0, -1e-3, 0.0, 0.0),
        (1.0, 0.0, f32::INFINITY, 0.0),
        (0.5, 0.0, 0.0, f32::NAN),
        (0.5, 0.0, 0.0, 0.6),
    ] {
        let mut mesh = Mesh::triangle(good());
        mesh.material = Material {
            power_transmission,
            power_reflection,
            roughness_m,
            rough_albedo,
        };
        assert!(matches!(
            run(&of(&mesh)).unwrap_err(),
            SimError::Material { .. }
        ));
    }
    let point = |p: DVec3, v: DVec3, rcs_m2| Scene {
        points: vec![PointTarget {
            position_m: p,
            velocity_mps: v,
            rcs_m2,
        }],
        ..Default::default()
    };
    let (far, still) = (DVec3::Y * 3.0, DVec3::ZERO);
    for scene in [
        point(DVec3::NAN, still, 1.0),
        point(far, DVec3::splat(f64::INFINITY), 1.0),
        point(far, still, -1.0),
        point(far, still, f64::NAN),
    ] {
        assert!(matches!(
            run(&scene).unwrap_err(),
            SimError::Point { point: 0, .. }
        ));
    }
    let error = run(&point(DVec3::ZERO, still, 1.0)).unwrap_err();
    assert!(
        matches!(
            error,
            SimError::TooClose {
                what: "point target",
                index: 0,
                ..
            }
        ),
        "{error}"
    );
    let noise = |noise| Scene {
        noise,
        ..point(far, still, 1.0)
    };
    assert!(matches!(
        run(&noise(Noise::SnrDb(f64::NAN))).unwrap_err(),
        SimError::Snr { .. }
    ));
    assert!(run(&noise(Noise::SnrDb(10.0))).is_ok());
}

#[test]
fn jumps_are_refused_and_great_speeds_are_not() {
    let at = |speed: f64| Scene {
        points: vec![PointTarget {
            position_m: DVec3::Y * 5.0,
            velocity_mps: DVec3::Y * speed,
            rcs_m2: 1.0,
        }],
        noise: Noise::Off,
        ..Default::default()
    };
    let mut simulator =
        Simulator::new(&RadarConfig::awr1843boost(), SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    assert!(
        simulator
            .simulate_frame(&at(40.0), 0, 0.0, 1, &mut cube)
            .is_ok()
    );
    let error = simulator
        .simulate_frame(&at(2000.0), 0, 0.0, 1, &mut cube)
        .unwrap_err();
    assert!(matches!(error, SimError::TooFast { .. }), "{error}");
}

#[test]
fn shapes_times_and_options_are_checked() {
    let mut simulator = Simulator::new(&config(), SimOptions::default()).unwrap();
    let scene = Scene::default();
    let mut cube = simulator.new_cube();
    cube.data.pop();
    let error = simulator
        .simulate_frame(&scene, 0, 0.0, 1, &mut cube)
        .unwrap_err();
    assert!(
        matches!(
            error,
            SimError::CubeShape {
                expected: [4, 3, 4, 256],
                ..
            }
        ),
        "{error}"
    );
    let mut cube = RadarCube::zeros(4, 4, 3, 256);
    assert!(
        simulator
            .simulate_frame(&scene, 0, 0.0, 1, &mut cube)
            .is_err()
    );
    let mut cube = simulator.new_cube();
    let error = simulator
        .simulate_frame(&scene, 0, f64::NAN, 1, &mut cube)
        .unwrap_err();
    assert!(matches!(error, SimError::Time { .. }));
    for options in [
        SimOptions {
            raster_size: 0,
            ..Default::default()
        },
        SimOptions {
            raster_size: 1 << 20,
            ..Default::default()
        },
        SimOptions {
            min_range_m: f64::NAN,
            ..Default::default()
        },
        SimOptions {
            min_range_m: 0.0,
            ..Default::default()
        },
    ] {
        assert!(matches!(
            Simulator::new(&config(), options),
            Err(SimError::Option { .. })
        ));
    }
    for (broken, field) in [
        (
            RadarConfig {
                n_samples: 0,
                ..config()
            },
            "n_samples",
        ),
        (
            RadarConfig {
                tx: vec![],
                ..config()
            },
            "tx",
        ),
        // 256 samples at 4.4 Msps end 58.2 us later, after the ramp's 65 us.
        (
            RadarConfig {
                adc_start_s: 8e-6,
                ..config()
            },
            "adc_start_s",
        ),
        (
            RadarConfig {
                slope_hz_per_s: f64::NAN,
                ..config()
            },
            "slope_hz_per_s",
        ),
    ] {
        let error = Simulator::new(&broken, SimOptions::default()).map(|_| ());
        assert!(
            matches!(&error, Err(SimError::Config(e)) if e.field == field),
            "{field}: {error:?}"
        );
    }
}

/// Negative ranges do not exist: what lies behind the array's plane is simply not seen.
#[test]
fn what_lies_behind_the_radar_adds_nothing() {
    let behind = good().map(|p| Vec3::new(p.x, -p.y, p.z));
    let mut mesh = Mesh::triangle(behind);
    mesh.triangles.push([0, 2, 1]);
    mesh.material.rough_albedo = 0.1;
    let mut scene = of(&mesh);
    scene
        .points
        .push(PointTarget::at(DVec3::new(0.3, -2.0, 0.0), 1.0));
    let silent = |cube: RadarCube| cube.data.iter().all(|z| z.norm() == 0.0);
    assert!(silent(run(&scene).unwrap()));
    scene.points[0].position_m.y = 2.0;
    assert!(!silent(run(&scene).unwrap()));
}

/// Edges of three facets, doubled facets, a bow tie on one vertex: facets know nothing of each other.
#[test]
fn meshes_need_not_be_manifold() {
    let mut mesh = Mesh::triangle(good());
    mesh.vertices.push(Vec3::new(0.05, 1.9, 0.05));
    mesh.vertices.push(Vec3::new(-0.1, 2.0, -0.1));
    mesh.vertices.push(Vec3::new(-0.1, 2.0, 0.0));
    mesh.triangles = vec![
        [0, 1, 2],
        [0, 1, 2],
        [0, 1, 3],
        [1, 0, 3],
        [0, 1, 5],
        [0, 5, 4],
    ];
    mesh.material.rough_albedo = 0.1;
    run(&of(&mesh)).unwrap();
}

/// A claim of more vertices than 32-bit indices serve is refused before anything is made for them.
#[test]
fn too_many_vertices_are_refused_before_any_memory() {
    struct Huge;
    impl MovingSurface for Huge {
        fn triangles(&self) -> &[[u32; 3]] {
            &[]
        }
        fn n_vertices(&self) -> usize {
            usize::MAX / 4
        }
        fn positions_at(&self, _: f64, _: &mut [Vec3]) {
            unreachable!("refused before")
        }
        fn material(&self) -> Material {
            Material::PEC
        }
    }
    let scene = Scene {
        surfaces: vec![&Huge, &Huge],
        ..Scene::default()
    };
    assert!(matches!(
        run(&scene).unwrap_err(),
        SimError::TooMany {
            limit: 67_108_864,
            ..
        }
    ));
}

#[test]
fn odd_places_make_no_nan() {
    // Behind, beside and across the array's plane; grazing; a sliver.
    let meshes = [
        [
            Vec3::new(0.0, -2.0, 0.0),
            Vec3::new(0.1, -2.0, 0.0),
            Vec3::new(0.0, -2.0, 0.1),
        ],
        [
            Vec3::new(2.0, 0.0, 0.0),
            Vec3::new(2.0, 0.1, 0.0),
            Vec3::new(2.0, 0.0, 0.1),
        ],
        [
            Vec3::new(-3.0, -1.0, 1.0),
            Vec3::new(3.0, 1.0, 1.0),
            Vec3::new(0.0, 5.0, 1.0),
        ],
        [
            Vec3::new(0.0, 2.0, 0.0),
            Vec3::new(0.0, 3.0, 0.0),
            Vec3::new(0.0, 2.5, 1e-7),
        ],
        [
            Vec3::new(0.0, 900.0, 0.0),
            Vec3::new(300.0, 900.0, 0.0),
            Vec3::new(0.0, 900.0, 300.0),
        ],
    ];
    for vertices in meshes {
        let mut mesh = Mesh::triangle(vertices);
        mesh.triangles.push([0, 2, 1]);
        mesh.material.rough_albedo = 0.1;
        run(&of(&mesh)).unwrap();
    }
}
