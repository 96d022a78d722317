//! Whether pictures of made scans are judged as what stands in them: one known disc, and a room of few points.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod studio;

use std::f64::consts::PI;
use std::sync::Arc;

use cloud::{Chunk, pack_normal, pack_radius};
use glam::DVec3;
use scene::five_mirrors::{SampledPart, Variant};
use scene::{Settings, Tripod};
use study::Subject;
use study::referee::{JUDGED, Referee};

use studio::studio;

/// The pixels of a disc of this radius that faces the camera from the end of `way`, by its angle.
fn covered(way: DVec3, forward: DVec3, radius: f64) -> f64 {
    let pixel = 2.0 * 30.0_f64.to_radians().tan() / f64::from(JUDGED[1]);
    PI * (radius / way.length() / pixel).powi(2) / way.normalize().dot(forward).powi(3)
}

#[test]
fn a_lone_disc_in_the_picture_is_in_front_behind_or_right_where_it_stands_so() {
    let Some(mut studio) = studio() else { return };
    let (camera, referee) = (Tripod::Room.camera(), Referee::new(Tripod::Room));
    // The wall at the end of the room.
    let wall = DVec3::new(8.0, 2.0, 2.5);
    for share in [0.4, 1.0, 1.5] {
        let way = (wall - camera.eye) * share;
        let radius = 0.03 * way.length();
        let chunk = Chunk {
            normals: Some(Arc::new(vec![pack_normal(-way.normalize().as_vec3())])),
            radii: Some(Arc::new(vec![pack_radius(radius as f32)])),
            ..Chunk::of_places(0, &[camera.eye + way])
        };
        let parts = vec![SampledPart { chunks: vec![chunk], mirror: None }];
        let mut settings = Settings::default();
        settings.splat.close_gaps = false;
        let subject = Subject::sampled(&studio.gpu, parts, Vec::new(), camera, None, &settings).unwrap();
        let shares = referee.draw_and_judge(&subject, &mut studio.renderer, &settings).unwrap().camera;
        let counts = [shares.in_front, shares.right, shares.behind].map(|share| share * shares.pixels as f64);
        let expected = covered(way, camera.forward(), radius);
        let own = counts[[0.4, 1.0, 1.5].iter().position(|known| *known == share).unwrap()];
        // The wall is seen at an angle, so a disc that faces the camera is off by some of it to its sides.
        assert!((own / expected - 1.0).abs() < 0.06, "{share}: {own} pixels, expected {expected}, {shares:?}");
        assert!((shares.empty + counts.iter().sum::<f64>() / shares.pixels as f64 - 1.0).abs() < 1e-9, "{shares:?}");
    }
}

#[test]
fn a_room_of_few_points_is_nearly_right_and_every_scan_can_be_judged() {
    let Some(mut studio) = studio() else { return };
    for scan in [Tripod::Even, Tripod::Room, Tripod::Mixed, Tripod::Hall, Tripod::Street, Tripod::Church] {
        let mut settings = scan.settings();
        settings.scene.points = 20_000;
        let subject = Subject::five_mirrors(&studio.gpu, Variant::Tripod(scan), &settings).unwrap();
        let verdict = Referee::new(scan).draw_and_judge(&subject, &mut studio.renderer, &settings).unwrap();
        for shares in [verdict.camera, verdict.mirrors] {
            let all = shares.right + shares.in_front + shares.behind + shares.empty;
            assert!((all - 1.0).abs() < 1e-9 && shares.pixels > 4000, "{scan:?}: {shares:?}");
        }
        if matches!(scan, Tripod::Even | Tripod::Room) {
            let right = [verdict.camera.right, verdict.mirrors.right];
            assert!(right.iter().all(|share| *share > 0.92) && verdict.covered > 0.95, "{scan:?}: {verdict:?}");
        }
    }
}

#[test]
fn the_exact_surfaces_of_a_scan_are_those_that_its_points_lie_on() {
    use trace::{Geometry as _, Ray};
    let settings = Settings::default();
    let exact = study::Exact::five_mirrors(Variant::Tripod(Tripod::Church));
    let parts = scene::five_mirrors::sample(Variant::Tripod(Tripod::Hall), 2000, settings.scene.seed.into());
    let hall = study::Exact::five_mirrors(Variant::Tripod(Tripod::Hall)).seen_from(DVec3::new(5.0, -3.0, 1.0));
    let station = Tripod::Hall.stations()[0];
    let mut met = 0;
    for chunk in &parts[0].chunks {
        for index in 0..chunk.len() {
            let way = chunk.position(index) - station;
            let ray = Ray::from_eye(station - DVec3::new(5.0, -3.0, 1.0), way.normalize());
            let hit = hall.nearest(&ray).unwrap();
            // The mirrors stand before some of it, and no scanner saw them.
            let is_mirror = hit.specular_intensity > 0.0;
            assert!(is_mirror || (hit.distance - way.length()).abs() < 1e-5, "{hit:?}");
            assert!(hall.is_blocked(&ray, way.length() * 1.01) && !hall.is_blocked(&ray, hit.distance * 0.99));
            met += usize::from(!is_mirror);
        }
    }
    assert!(met > 1800, "{met}");
    assert!(exact.nearest(&Ray::from_eye(DVec3::new(15.0, 5.0, 7.0), DVec3::Z)).is_some_and(|hit| hit.distance == 4.0));
}
