//! The parameters of mirrors.

use param::{choices, params};

choices! {
    /// How mirrors that have a formula come into the camera's G-buffer.
    pub enum MirrorSurface { Auto = "auto", Exact = "exact", Points = "points" }
}
choices! {
    /// How the share that a mirror reflects depends on the angle at which it is seen.
    pub enum FresnelLaw { Schlick = "schlick", Published = "published" }
}

choices! {
    /// What a mirror shows that the last reflection meets.
    pub enum LastMirror { Matt = "matt", Dark = "dark" }
}

params! {
    /// Mirrors.
    pub struct MirrorSettings = "mirror" in "Reflections" => affects(shading truth) {
        /// Mirrors that have a formula: exact casts a ray a pixel, points splats samples of them; auto takes points for the built-in scenes.
        surface: MirrorSurface = MirrorSurface::Auto => affects(surface found truth);
        /// What mirrors show that the last reflection meets (reflection.bounces): their own colour, as matt surfaces do (matt), or, as published by Preiner (2010), only the share of it that they do not reflect (dark).
        last: LastMirror = LastMirror::Matt;
        /// Share of a mirror's own colour that its reflections take on, as metals do.
        tint: f32 = 0.0, 0.0..=1.0, "share";
        /// How far the share that is reflected follows the angle of the line of sight by mirror.fresnel_law; at 0 it does not.
        fresnel: f32 = 0.0, 0.0..=1.0, "share";
        /// Schlick reflects more the flatter the line of sight, as real surfaces do (Schlick 1994); published reflects less, by the square of its cosine with the normal, as the weight that Popescu, Sacks and Mei (2006) call Fresnel's, though real reflectance rises where it falls.
        fresnel_law: FresnelLaw = FresnelLaw::Schlick;
        /// Distance between a mirror and what it reflects at which that has faded to mirror.fade_least, by the square of what is left of the way (Popescu, Sacks and Mei 2006): the mirror's own diffuse light takes its place. Half the diagonal of the box about a mirror's points is its radius. 0 fades nothing; clear surfaces never fade.
        fade_distance: f32 = 0.0, 0.0..=10.0, "mirror radii";
        /// Share of a reflection that is left at mirror.fade_distance and beyond, and where nothing is met.
        fade_least: f32 = 0.0, 0.0..=1.0, "share";
    }
}
