//! Reflections that are not followed because they count little: what that changes, and that some are left out.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod studio;

use render::Aov;
use scene::Settings;
use scene::five_mirrors::{self, Variant};
use study::{Subject, image_error};

use studio::{Studio, studio};

const SIZE: [u32; 2] = [120, 90];

#[test]
fn what_the_default_does_not_follow_is_not_seen() {
    let Some(mut studio) = studio() else { return };
    let Studio { gpu, renderer } = &mut *studio;
    let mut settings = Settings::default();
    (settings.gi.bounces, settings.reflection.bounces) = (0, 8);
    // The third reflection of mirrors of 0.27, and the second one of mirrors of 0.14, count for a little less than the
    // default: what is left out counts for most there.
    for intensity in [1.0, 0.27, 0.14] {
        let mut parts = five_mirrors::sample(Variant::All, 100_000, 1);
        parts
            .iter_mut()
            .filter_map(|part| part.mirror.as_mut())
            .for_each(|mirror| mirror.specular_intensity = intensity);
        let (lights, camera) = (vec![five_mirrors::light()], five_mirrors::camera());
        let subject = Subject::sampled(gpu, parts, lights, camera, None, &settings).unwrap();
        for method in ["surfel_trace", "sscr_hierarchical", "cubemap_trace", "screen_trace"] {
            settings.set_text("reflection.method", method).unwrap();
            let [all, heavy] = [0.0, Settings::default().reflection.least_weight].map(|least| {
                settings.reflection.least_weight = least;
                subject.render(renderer, &settings, SIZE).unwrap();
                let color = renderer.read_aov(Aov::Color).unwrap().data;
                // Empty pixels are not finite.
                color.iter().map(|value| if value.is_finite() { *value } else { 0.0 }).collect::<Vec<f32>>()
            });
            let mirror: Vec<bool> =
                renderer.read_aov(Aov::Mirror).unwrap().data.iter().map(|share| *share > 0.0).collect();
            let error = image_error(SIZE[0] as usize, &mirror, heavy.as_chunks::<3>().0, all.as_chunks::<3>().0);
            let what = format!("{method}, mirrors of {intensity}: {:.4}", error.delta_e);
            println!("{what}");
            assert!(error.delta_e < 0.1, "{what}");
            // Where mirrors reflect all, each reflection counts as much as the first.
            assert_eq!(all != heavy, intensity < 1.0, "{what}");
        }
    }
}
