//! Where the places of a coordinate system lie on the globe.

use proj4rs::Proj;
use proj4rs::transform::transform;

/// From a system with a code of the EPSG to WGS 84.
pub struct Globe {
    own: Proj,
    globe: Proj,
}

impl Globe {
    /// `None` if the code or its projection is not known, and of a system about the middle of the globe, which has no
    /// map.
    pub fn of(code: u32) -> Option<Self> {
        let own = crs_definitions::from_code(code.try_into().ok()?)?;
        let globe = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok()?;
        let own = Proj::from_proj_string(own.proj4).ok().filter(|own| !own.is_geocent())?;
        Some(Self { own, globe })
    }

    /// Longitude and latitude in degrees of a place. Shifts between datums are as exact as PROJ strings say them: some
    /// metres.
    pub fn degrees(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let own = if self.own.is_latlong() { [x.to_radians(), y.to_radians()] } else { [x, y] };
        let mut place = (own[0], own[1], 0.0);
        transform(&self.own, &self.globe, &mut place).ok()?;
        let degrees = [place.0.to_degrees(), place.1.to_degrees()];
        degrees.iter().all(|angle| angle.is_finite()).then_some(degrees)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_projections_lie_where_proj_puts_them() {
        // By PROJ 9. The first three have the datum WGS 84 or ETRS 89.
        for (code, place, expected, within) in [
            (32_633, [500_000.0, 5_000_000.0], [15.0, 45.153_477_183], 1e-8),
            (25_832, [691_000.0, 5_335_000.0], [11.567_501_229, 48.139_558_350], 1e-8),
            (4326, [8.5, 47.4], [8.5, 47.4], 1e-12),
            (2056, [2_600_000.0, 1_200_000.0], [7.438_632_421, 46.951_082_773], 1e-5),
            // Feet of the survey, and three ways to project.
            (2927, [1_200_000.0, 700_000.0], [-122.273_135_630, 47.239_267_192], 2e-5),
            (2949, [500_000.0, 5_000_000.0], [-68.019_182_005, 45.113_030_369], 2e-5),
            (3005, [1_000_000.0, 500_000.0], [-126.0, 49.516_295_701], 2e-5),
        ] {
            let found = Globe::of(code).unwrap().degrees(place).unwrap();
            let off = (found[0] - expected[0]).abs().max((found[1] - expected[1]).abs());
            assert!(off < within, "{code}: {found:?}");
        }
        assert!([1, 70_000, 4978].iter().all(|code| Globe::of(*code).is_none()));
        assert_eq!(Globe::of(32_633).unwrap().degrees([f64::NAN, 0.0]), None);
    }
}
