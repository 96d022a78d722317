//! The names by which other programs know the standard attributes. Everything that looks for an attribute by its name
//! asks here, so a mode of colour that wants `intensity` finds `scalar_Intensity`, too.

use crate::Attribute;

/// The names of the standard attributes as this program has them (LAS 1.4), and other names of the same, in lower case
/// without `scalar_`, underscores and spaces. CloudCompare writes `scalar_` before the names of its scalar fields, PDAL
/// capitals within them.
const STANDARD: [(&str, &[&str]); 16] = [
    ("intensity", &[]),
    ("return_number", &[]),
    ("number_of_returns", &["returncount"]),
    ("scan_direction_flag", &["scandirection"]),
    ("edge_of_flight_line", &["edgeofflightlineflag"]),
    ("classification", &["class"]),
    ("synthetic", &["syntheticflag"]),
    ("key_point", &["keypointflag", "modelkeypoint"]),
    ("withheld", &["withheldflag"]),
    ("overlap", &["overlapflag"]),
    ("scanner_channel", &["scanchannel"]),
    ("scan_angle", &["scananglerank"]),
    ("user_data", &[]),
    ("point_source_id", &["pointsource"]),
    ("gps_time", &[]),
    ("nir", &["nearinfrared", "infrared"]),
];

/// The standard attribute that a name means in some program's files; `None` for any other name.
pub fn standard_name(name: &str) -> Option<&'static str> {
    const PREFIX: &str = "scalar_";
    let own = match name.get(..PREFIX.len()) {
        Some(start) if start.eq_ignore_ascii_case(PREFIX) => &name[PREFIX.len()..],
        _ => name,
    };
    let plain = |name: &str| -> String {
        name.chars().filter(|sign| !matches!(sign, '_' | ' ' | '-')).map(|sign| sign.to_ascii_lowercase()).collect()
    };
    let own = plain(own);
    let means = |(standard, others): &&(&str, &[&str])| plain(standard) == own || others.contains(&own.as_str());
    STANDARD.iter().find(means).map(|(standard, _)| *standard)
}

/// The columns that a comparison of two clouds adds to points: the distance of each, and how large one must be to count.
pub const COMPARED: [&str; 2] = ["distance", "level_of_detection"];
/// The column that says how far the place of a ghost may be off.
pub const GHOST_ERROR: &str = "ghost_error";
/// The column that says how far the surface may be off along its normal: the half width of an interval.
pub const SURFACE_ERROR: &str = "surface_error";

/// Whether a column has this name, or is a further one of it, which has a number: `distance_2`.
pub fn is_numbered(name: &str, of: &str) -> bool {
    let rest = name.strip_prefix(of);
    let number = rest.and_then(|rest| rest.strip_prefix('_'));
    rest == Some("") || number.is_some_and(|number| number.parse::<u32>().is_ok())
}

/// Whether a column is one of those of lengths that glint adds to points.
pub fn is_length(name: &str) -> bool {
    COMPARED.into_iter().chain([GHOST_ERROR, SURFACE_ERROR]).any(|own| is_numbered(name, own))
}

/// The index of the attribute that `name` names: the one that is called so, else the first that means the same.
pub fn attribute_named(attributes: &[Attribute], name: &str) -> Option<usize> {
    let called = attributes.iter().position(|attribute| attribute.name == name);
    called.or_else(|| {
        let wanted = standard_name(name)?;
        attributes.iter().position(|attribute| standard_name(&attribute.name) == Some(wanted))
    })
}

/// For each attribute, whether one of `names` names it.
pub fn attributes_named<'a>(attributes: &[Attribute], names: impl IntoIterator<Item = &'a str>) -> Vec<bool> {
    let mut named = vec![false; attributes.len()];
    names.into_iter().filter_map(|name| attribute_named(attributes, name)).for_each(|index| named[index] = true);
    named
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ColumnType;

    #[test]
    fn names_of_other_programs_mean_the_standard_attributes() {
        for (name, standard) in [
            ("scalar_Intensity", "intensity"),
            ("scalar_NIR", "nir"),
            ("scalar_intensity", "intensity"),
            ("Intensity", "intensity"),
            ("scalar_Classification", "classification"),
            ("scalar_GpsTime", "gps_time"),
            ("scalar_Gps_Time", "gps_time"),
            ("GPS Time", "gps_time"),
            ("scalar_ReturnNumber", "return_number"),
            ("scalar_Return_Number", "return_number"),
            ("scalar_NumberOfReturns", "number_of_returns"),
            ("scalar_PointSourceId", "point_source_id"),
            ("scalar_ScanAngleRank", "scan_angle"),
            ("scalar_EdgeOfFlightLine", "edge_of_flight_line"),
            ("scalar_Withheld_flag", "withheld"),
            ("intensity", "intensity"),
        ] {
            assert_eq!(standard_name(name), Some(standard), "{name}");
        }
        for name in ["scalar", "scalar_", "scalar_Illuminance_(PCV)", "intensities", "", "scalär_x"] {
            assert_eq!(standard_name(name), None, "{name}");
        }
    }

    #[test]
    fn an_attribute_is_found_by_its_own_name_first() {
        let attributes: Vec<Attribute> = ["scalar_Intensity", "intensity", "scalar_GpsTime", "wet"]
            .map(|name| Attribute { name: name.into(), column_type: ColumnType::F32 })
            .into();
        let found = |name| attribute_named(&attributes, name);
        assert_eq!((found("intensity"), found("scalar_Intensity"), found("Intensity")), (Some(1), Some(0), Some(0)));
        assert_eq!((found("gps_time"), found("wet"), found("Wet"), found("class")), (Some(2), Some(3), None, None));
    }
}
