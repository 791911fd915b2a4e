//! Meshes of nested boxes.

use glam::DVec3;
use mipvog::bake::BakeOptions;
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog::view::render::Renderer;
use mipvog_outputs::gltf::mesh::{Mesh, meshes};
use mipvog_testing::world::world;

use crate::bake::nested::baked;

/// The distance at which a ray first meets a mesh.
fn hit(mesh: &Mesh, ray: &Ray) -> Option<f64> {
    let meets = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|at| mesh.positions[at as usize].map(f64::from));
        let (a, b, c) = (DVec3::from(a), DVec3::from(b), DVec3::from(c));
        let (along, across) = (b - a, c - a);
        let normal = ray.direction.cross(across);
        let scale = along.dot(normal);
        let from = ray.origin - a;
        let u = from.dot(normal) / scale;
        let turned = from.cross(along);
        let v = ray.direction.dot(turned) / scale;
        let t = across.dot(turned) / scale;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
    };
    mesh.triangles.iter().filter_map(meets).min_by(f64::total_cmp)
}

#[test]
fn a_mesh_of_a_world_has_its_ground_its_hills_and_its_sky() {
    let container = baked(&world(33, 3), &BakeOptions::default());
    let made = meshes(&container, 12_000, 1).expect("meshes");
    let counts: Vec<usize> = made.iter().map(|mesh| mesh.triangles.len()).collect();
    assert!(counts[0] <= 12_000 && counts[0] > 4_000, "{counts:?}");
    assert!(counts.len() == 2 && counts[1] <= 3_000, "{counts:?}");
    let field = Renderer::of_container(&container).expect("a renderer");
    let place = DVec3::new(-0.6, -0.4, 0.2);
    let ways = (0..200).map(|number| {
        let height = 1.0 - (2.0 * f64::from(number) + 1.0) / 200.0;
        let (sin, cos) = (2.4 * f64::from(number)).sin_cos();
        let flat = (1.0 - height * height).sqrt();
        DVec3::new(flat * cos, flat * sin, height)
    });
    let rays: Vec<Ray> = ways.map(|direction| Ray { origin: place, direction }).collect();
    let light = field.ray_colors(&rays, 0, &Silent).expect("rays");
    let (mut near, mut far, mut missed) = (0, 0, 0);
    for (ray, light) in rays.iter().zip(light) {
        let Some(found) = hit(&made[0], ray) else {
            missed += 1;
            continue;
        };
        // Nodes of the box at that distance.
        let edge = 2.0 / 32.0 * f64::from(light.distance).max(1.0);
        near += usize::from((found - f64::from(light.distance)).abs() < 2.0 * edge);
        far += usize::from(light.distance > 3.0);
    }
    // At edges that are seen sidelong they differ; through faces of boxes a ray may slip.
    assert!(near >= 175 && far > 50, "{near} of 200 agree, {far} are far");
    assert!(missed <= 2, "{missed} rays meet nothing");
}
