//! Tests of the mirrors for which a formula says where they reflect a point: the GPU against closed forms in doubles.

use glam::{DVec2, DVec3, UVec2, Vec3};
use scene::five_mirrors::{Variant, camera};
use scene::{BundleRest, Mirror, SampleCameras as Parameters, Shape};

use super::tests::{RADIUS, all_points, made, made_with, on_screen, place_on_sphere, plane_picture, quantile};
use crate::Gpu;
use crate::layout::{POINTS_FOUND, RAYS_LEFT, REGIONS};
use crate::reflection::sscr::exact_mirrors::{picture, wall_points};
use crate::reflection::sscr::twin::{MirrorPicture, MirrorPixel};

const SIZE: UVec2 = UVec2::new(400, 300);

fn ball() -> Mirror {
    Variant::Sphere.mirrors().remove(0)
}

/// How far the place of each point's root is from a closed form's, and the numbers of roots that are missing although
/// the mirror is more than two pixels wide about them, and of those where there is none.
fn compared(
    picture: &MirrorPicture,
    found: &[Vec<super::twin::Root>],
    points: &[Vec3],
    place: impl Fn(DVec3) -> Option<DVec2>,
) -> (Vec<f64>, usize, usize) {
    let is_mirror = |at: DVec2| {
        let is_in = at.min_element() >= 0.0 && at.cmplt(picture.size.as_dvec2()).all();
        is_in && picture.pixels[(at.y as u32 * picture.size.x + at.x as u32) as usize].is_some()
    };
    let (mut off, mut lost, mut odd) = (Vec::new(), 0, 0);
    for (q, roots) in points.iter().zip(found) {
        match (place(q.as_dvec3()), &roots[..]) {
            (Some(truth), [root]) => off.push(truth.distance(root.at)),
            (Some(truth), []) => {
                let sides = [DVec2::X, DVec2::Y, -DVec2::X, -DVec2::Y];
                lost += usize::from(sides.iter().all(|side| is_mirror(truth + 2.0 * *side)));
            }
            (None, []) => {}
            _ => odd += 1,
        }
    }
    (off, lost, odd)
}

#[test]
fn a_formula_tells_where_a_ball_reflects_each_point() {
    let Some(gpu) = Gpu::shared() else { return };
    let picture = picture(Variant::Sphere, SIZE);
    let points = wall_points(20_000);
    let made = made_with(&gpu, &picture, &[ball()], &points, RADIUS, &all_points());
    let place = |q| place_on_sphere(-camera().eye, 0.43, q).map(|place| on_screen(place, SIZE));
    let (off, lost, odd) = compared(&picture, &made.roots, &points, place);
    // Places are kept to a quarter of a pixel.
    let most = off.iter().copied().fold(0.0, f64::max);
    assert!(off.len() > 10_000 && most < 0.25 && lost == 0 && odd == 0, "{} {most} {lost} {odd}", off.len());
    assert_eq!((made.counters[REGIONS], made.counters[RAYS_LEFT]), (0, 0), "no square is fitted, no ray left");
}

#[test]
fn a_formula_tells_where_a_plane_reflects_each_point() {
    let Some(gpu) = Gpu::shared() else { return };
    let (picture, normal, middle) = plane_picture(SIZE);
    let points = wall_points(20_000);
    // The picture shows nothing else, wherever the rectangle ends.
    let plate = Mirror::standing(Shape::Plane { height: 1.0 }, DVec3::ZERO, -normal, DVec3::Y, 9.0);
    let plate = Mirror { position: middle + camera().eye, ..plate };
    let made = made_with(&gpu, &picture, &[plate], &points, RADIUS, &all_points());
    let mirrored = normal * (2.0 * middle.dot(normal));
    let place = |q: DVec3| {
        let share = (middle - mirrored).dot(normal) / (q - mirrored).dot(normal);
        let at = on_screen(mirrored + (q - mirrored) * share, SIZE);
        let is_seen = share > 0.0 && share < 1.0 && at.min_element() >= 0.0 && at.cmplt(SIZE.as_dvec2()).all();
        is_seen.then_some(at)
    };
    let (off, lost, odd) = compared(&picture, &made.roots, &points, place);
    let most = off.iter().copied().fold(0.0, f64::max);
    // Places are kept to a quarter of a pixel, and to a half at the edge of the picture; points beside the plane are
    // its own.
    assert!(off.len() > 1000 && most < 0.4 && lost * 1000 < off.len() && odd == 0, "{} {most} {lost} {odd}", off.len());
    assert_eq!(made.counters[REGIONS], 0);
}

#[test]
fn formulas_leave_other_mirrors_to_squares() {
    let Some(gpu) = Gpu::shared() else { return };
    let (picture, points) = (picture(Variant::Sphere, SIZE), wall_points(4000));
    let by_squares = made(&gpu, &picture, &points, &all_points());
    assert!(by_squares.counters[REGIONS] > 100);
    // A ball elsewhere, one that hollows out the eye's place, and another shape reflect nothing of this picture.
    let elsewhere = Mirror { position: DVec3::new(0.0, 2.0, 0.0), ..ball() };
    let around = Mirror { size: 9.0, ..ball() };
    let other = Variant::Torus.mirrors().remove(0);
    let made_too = made_with(&gpu, &picture, &[elsewhere, around, other], &points, RADIUS, &all_points());
    assert_eq!(made_too.roots.len(), by_squares.roots.len());
    assert_eq!(made_too.counters, by_squares.counters);
    // Nor does the ball itself, if its formula is not asked.
    let unasked = Parameters { analytic: false, ..all_points() };
    assert_eq!(made_with(&gpu, &picture, &[ball()], &points, RADIUS, &unasked).counters, by_squares.counters);
}

#[test]
fn thinned_points_are_as_dense_by_formula_as_by_squares() {
    let Some(gpu) = Gpu::shared() else { return };
    let (picture, points) = (picture(Variant::Sphere, SIZE), wall_points(200_000));
    // The discs of points must close the walls.
    let radius = 1.5 * (40.0 / (std::f32::consts::PI * points.len() as f32)).sqrt();
    let parameters = Parameters { points_per_pixel: 1.0, rest: BundleRest::None, ..Parameters::default() };
    let by_squares = made_with(&gpu, &picture, &[], &points, radius, &parameters);
    let by_formula = made_with(&gpu, &picture, &[ball()], &points, radius, &parameters);
    let counts = [by_squares, by_formula].map(|made| f64::from(made.counters[POINTS_FOUND]));
    let pixels = picture.pixels.iter().flatten().count() as f64;
    assert!((counts[1] / counts[0] - 1.0).abs() < 0.1 && counts[1] < 1.3 * pixels, "{counts:?} of {pixels} pixels");
}

#[test]
fn rays_of_points_that_do_not_follow_the_formula_are_left() {
    let Some(gpu) = Gpu::shared() else { return };
    let mut picture = picture(Variant::Sphere, SIZE);
    let tilt = Vec3::new(0.05, 0.0, 0.0);
    let left = |pixel: &MirrorPixel| pixel.point.x < 0.0;
    let tilted = picture.pixels.iter_mut().flatten().filter(|pixel| left(pixel));
    tilted.for_each(|pixel| pixel.normal = (pixel.normal + tilt).normalize());
    let points = wall_points(20_000);
    let drawn = Mirror { as_points: true, ..ball() };
    let made = made_with(&gpu, &picture, &[drawn], &points, RADIUS, &all_points());
    let halves = picture.pixels.iter().flatten().filter(|pixel| left(pixel)).count() as f64;
    let share = f64::from(made.counters[RAYS_LEFT]) / halves;
    // At the rim the tilt is along the normal.
    assert!(share > 0.85 && share < 1.0, "{share} of the tilted half");
    let place = |q| place_on_sphere(-camera().eye, 0.43, q).map(|place| on_screen(place, SIZE));
    let mut off = [Vec::new(), Vec::new()];
    for (q, roots) in points.iter().zip(&made.roots) {
        let Some(truth) = place(q.as_dvec3()) else { continue };
        let half = usize::from(truth.x >= f64::from(SIZE.x) * 0.5);
        off[half].extend(roots.iter().map(|root| root.at.distance(truth)));
    }
    // A tilted ray does not pass what the ball would show there.
    let [tilted, plain] = off;
    assert!(plain.len() > 3000 && tilted.len() * 5 < plain.len(), "{} {}", tilted.len(), plain.len());
    assert!(quantile(plain, 1.0) < 0.25);
}
