//! Which properties of other files mean what fields of LAS records mean, and how their values become those of a field.

use cloud::{Column, ColumnType};

/// The number of steps of an angle of formats 6 to 10 in a degree.
pub const ANGLE_STEPS: f64 = 1.0 / 0.006;
/// The share of the values that decide a scale; the others are beyond it.
const MOST: f64 = 0.99;
/// The ends of the scales of brightness, and the factors that bring them to 16 bits.
const BRIGHTNESS: [(f64, f64); 3] = [(1.0, 65535.0), (255.0, 257.0), (65535.0, 1.0)];

/// The number of seconds in a week.
const WEEK: f64 = 604_800.0;

/// The values that a field takes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Takes {
    /// Whole numbers from 0 to this one.
    Whole(f64),
    /// 16 bits of brightness.
    Brightness,
    /// Degrees from -180 to 180, in steps of 0.006.
    Degrees,
    /// Any number.
    Seconds,
}

/// A field that records of LAS have.
#[derive(Debug, PartialEq)]
pub struct Standard {
    pub name: &'static str,
    /// The names by which other programs have it, in lower case and without anything but letters and digits.
    others: &'static [&'static str],
    takes: Takes,
}

/// Fields that properties of other files fill. Near infrared is in format 8 alone.
pub static STANDARD: [Standard; 16] = {
    const fn field(name: &'static str, others: &'static [&'static str], takes: Takes) -> Standard {
        Standard { name, others, takes }
    }
    use Takes::{Brightness, Degrees, Seconds, Whole};
    [
        field("intensity", &["intensity"], Brightness),
        field("return_number", &["returnnumber"], Whole(15.0)),
        field("number_of_returns", &["numberofreturns"], Whole(15.0)),
        field("synthetic", &["synthetic", "syntheticflag", "classifsyntheticflag"], Whole(1.0)),
        field("key_point", &["keypoint", "keypointflag", "classifkeypointflag"], Whole(1.0)),
        field("withheld", &["withheld", "withheldflag", "classifwithheldflag"], Whole(1.0)),
        field("overlap", &["overlap", "overlapflag"], Whole(1.0)),
        field("scanner_channel", &["scannerchannel", "scanchannel"], Whole(3.0)),
        field("scan_direction_flag", &["scandirectionflag", "scandirection"], Whole(1.0)),
        field("edge_of_flight_line", &["edgeofflightline", "edgeofflightlineflag"], Whole(1.0)),
        field("classification", &["classification", "classifvalue"], Whole(255.0)),
        field("user_data", &["userdata"], Whole(255.0)),
        field("scan_angle", &["scanangle", "scananglerank"], Degrees),
        field("point_source_id", &["pointsourceid", "pointsource"], Whole(65535.0)),
        field("gps_time", &["gpstime"], Seconds),
        field("nir", &["nir", "nearinfrared", "infrared"], Brightness),
    ]
};

/// Other names of standard dimensions of LAS, in this program or in others, which no extra dimension may have.
const RESERVED: [&str; 19] = [
    "x",
    "y",
    "z",
    "red",
    "green",
    "blue",
    "rawclassification",
    "classificationflags",
    "classflags",
    "bitfields",
    "flagbyte",
    "wavepacketindex",
    "wavepacketdescriptorindex",
    "wavepacketoffset",
    "wavepacketsize",
    "returnpointwavelocation",
    "xt",
    "yt",
    "zt",
];

/// A name without what programs write in different ways: upper case, blanks, the prefix that CloudCompare gives to all
/// scalars in PLY files.
fn plain(name: &str) -> String {
    let lower = name.to_lowercase();
    let own = lower.strip_prefix("scalar_").unwrap_or(&lower);
    own.chars().filter(|character| character.is_alphanumeric()).collect()
}

/// The field of LAS that a property of this name means.
pub fn standard(name: &str) -> Option<&'static Standard> {
    let plain = plain(name);
    STANDARD.iter().find(|standard| standard.others.contains(&plain.as_str()))
}

/// Whether an extra dimension of this name would be taken for a standard one.
pub fn is_reserved(name: &str) -> bool {
    let plain = plain(name);
    RESERVED.contains(&plain.as_str()) || standard(name).is_some()
}

/// What the values of a property are like.
#[derive(Clone, Debug)]
pub struct Values {
    points: u64,
    /// Values that are no finite number.
    none: u64,
    /// Values that are no whole number.
    broken: u64,
    /// Values within each scale of brightness.
    within: [u64; 3],
    pub least: f64,
    pub greatest: f64,
    /// Whether some angles lie between the steps of LAS.
    between_steps: bool,
}

impl Default for Values {
    fn default() -> Self {
        Self {
            points: 0,
            none: 0,
            broken: 0,
            within: [0; 3],
            least: f64::INFINITY,
            greatest: f64::NEG_INFINITY,
            between_steps: false,
        }
    }
}

impl Values {
    pub fn add(&mut self, column: &Column, kept: &[u32]) {
        self.points += kept.len() as u64;
        for index in kept {
            let value = column.value(*index as usize);
            if !value.is_finite() {
                self.none += 1;
                continue;
            }
            self.broken += u64::from(value.fract() != 0.0);
            for (within, (end, factor)) in self.within.iter_mut().zip(BRIGHTNESS) {
                // What rounds to the ends is within them.
                let slack = 0.5 / factor;
                *within += u64::from(value > -slack && value < end + slack);
            }
            self.least = self.least.min(value);
            self.greatest = self.greatest.max(value);
            let steps = value * ANGLE_STEPS;
            self.between_steps |= (steps - steps.round()).abs() > 0.02;
        }
    }

    /// Takes the scale of these values and others.
    pub fn share_scale(&mut self, all: &Self) {
        (self.points, self.broken, self.within) = (all.points - all.none, all.broken, all.within);
    }

    /// Whether times are standard time, as those before or beyond the seconds of a week are; `None` if all are zero, if a
    /// point has no time, or if there are no points.
    pub fn is_standard_time(&self) -> Option<bool> {
        let is_known = self.none == 0 && self.points > 0 && (self.least, self.greatest) != (0.0, 0.0);
        is_known.then_some(self.least < 0.0 || self.greatest > WEEK)
    }

    pub fn merge(&mut self, other: &Self) {
        self.points += other.points;
        self.none += other.none;
        self.broken += other.broken;
        self.within.iter_mut().zip(other.within).for_each(|(own, other)| *own += other);
        self.least = self.least.min(other.least);
        self.greatest = self.greatest.max(other.greatest);
        self.between_steps |= other.between_steps;
    }
}

/// How values become those of a field.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    pub factor: f64,
    /// What is said of it.
    pub word: Option<String>,
    /// Whether some values are beyond the scale, so that they are kept under another name, too.
    pub is_clamped: bool,
}

impl Standard {
    /// Whether its values have a scale of brightness.
    pub fn has_scale(&self) -> bool {
        self.takes == Takes::Brightness
    }

    /// How values of a property become those of the field; `None` if the field does not hold them.
    pub fn fit(&self, name: &str, column_type: ColumnType, values: &Values) -> Option<Fit> {
        let as_it_is = Fit { factor: 1.0, word: None, is_clamped: false };
        let is_within = |least: f64, greatest: f64| values.least >= least && values.greatest <= greatest;
        if values.points == 0 {
            return Some(as_it_is);
        }
        if values.none > 0 {
            return None;
        }
        match self.takes {
            Takes::Whole(most) => (values.broken == 0 && is_within(0.0, most)).then_some(as_it_is),
            Takes::Seconds => Some(as_it_is),
            Takes::Degrees => is_within(-180.0, 180.0).then(|| Fit {
                word: values
                    .between_steps
                    .then(|| format!("{name}: rounded to the steps of {}, 0.006 degrees", self.name)),
                ..as_it_is
            }),
            Takes::Brightness if self.name == "nir" && column_type == ColumnType::U8 => Some(Fit {
                factor: 257.0,
                word: Some(format!("{name}: 0 to 255 became 0 to 65535 of {}", self.name)),
                ..as_it_is
            }),
            Takes::Brightness => {
                let is_whole = values.broken == 0;
                let fits = |scale: &usize| values.within[*scale] as f64 >= MOST * values.points as f64;
                let scale = if is_whole { 2 } else { 0 };
                let scale = (scale..BRIGHTNESS.len()).find(fits)?;
                let (end, factor) = BRIGHTNESS[scale];
                let beyond = values.points - values.within[scale];
                let mut word = match (is_whole, factor == 1.0) {
                    (true, _) => String::new(),
                    (false, true) => format!("rounded to whole numbers of {}", self.name),
                    (false, false) => format!("0 to {end} became 0 to 65535 of {}", self.name),
                };
                if beyond > 0 {
                    let cut =
                        format!("{beyond} values beyond 0 to {end} became its ends, and are kept under another name");
                    word = if word.is_empty() { format!("{}, {cut}", self.name) } else { format!("{word}, {cut}") };
                }
                let word = (!word.is_empty()).then(|| format!("{name}: {word}"));
                Some(Fit { factor, word, is_clamped: beyond > 0 })
            }
        }
    }
}

/// The values of a column times a factor, as whole numbers.
pub fn scaled(column: &Column, factor: f64) -> Column {
    Column::F64((0..column.len()).map(|index| (column.value(index) * factor).round()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(name: &str, column: &Column) -> Option<Fit> {
        let mut values = Values::default();
        let kept: Vec<u32> = (0..column.len() as u32).collect();
        values.add(column, &kept);
        standard(name).unwrap().fit(name, column.column_type(), &values)
    }

    #[test]
    fn a_field_is_known_by_the_names_that_other_programs_give_it() {
        let known = |name: &str| standard(name).map(|standard| standard.name);
        for (name, of) in [
            ("intensity", "intensity"),
            ("scalar_Intensity", "intensity"),
            ("scalar_Number_Of_Returns", "number_of_returns"),
            ("NumberOfReturns", "number_of_returns"),
            ("scalar_ScanAngleRank", "scan_angle"),
            ("scalar_[Classif]_Value", "classification"),
            ("GpsTime", "gps_time"),
            ("scalar_Point_Source_ID", "point_source_id"),
            ("key_point", "key_point"),
            ("scalar_Withheld_Flag", "withheld"),
            ("Infrared", "nir"),
        ] {
            assert_eq!(known(name), Some(of), "{name}");
        }
        assert_eq!(["scalar_C2M", "time", "nx", "alpha", "class"].map(known), [None; 5]);
        assert!(
            is_reserved("X") && is_reserved("Scan Angle") && is_reserved("wavepacket_offset") && is_reserved("nir")
        );
        assert!(!is_reserved("nx") && !is_reserved("distance") && !is_reserved("intensity_2nd"));
    }

    #[test]
    fn the_page_of_formats_has_each_field_and_all_of_its_names() {
        let page = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/formats.md");
        let page = std::fs::read_to_string(page).unwrap();
        let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| ")).collect();
        for standard in &STANDARD {
            let row = rows.iter().find(|row| row.split('|').nth(1).is_some_and(|cell| cell.contains(standard.name)));
            let names = plain(row.unwrap().split('|').nth(2).unwrap());
            for other in standard.others.iter().filter(|other| !other.contains("flag") && !other.contains("classif")) {
                assert!(names.contains(other), "{other}");
            }
        }
    }

    #[test]
    fn values_fill_a_field_that_holds_them_all_and_no_other() {
        let floats = |values: &[f32]| Column::F32(values.to_vec());
        let plain =
            |name, column: &Column| fit(name, column).map(|fit| (fit.factor, fit.word.is_some(), fit.is_clamped));
        assert_eq!(plain("classification", &floats(&[0.0, 2.0, 255.0])), Some((1.0, false, false)));
        assert_eq!(plain("classification", &Column::I32(vec![0, 255])), Some((1.0, false, false)));
        for wrong in [&[0.5][..], &[-1.0], &[256.0], &[1.0, f32::NAN]] {
            assert_eq!(plain("classification", &floats(wrong)), None);
        }
        assert_eq!(plain("withheld", &floats(&[0.0, 2.0])), None);
        assert_eq!(plain("scan_angle", &floats(&[-180.0, 0.006, 15.0])), Some((1.0, false, false)));
        assert_eq!(plain("scan_angle", &Column::I8(vec![1])), Some((1.0, true, false)));
        assert_eq!(plain("scan_angle", &Column::I16(vec![181])), None);
        assert_eq!(plain("gps_time", &floats(&[-1.5, 1e9])), Some((1.0, false, false)));
        assert_eq!(plain("nir", &Column::U8(vec![1])), Some((257.0, true, false)));
    }

    #[test]
    fn most_values_decide_the_scale_of_intensity_and_not_the_largest() {
        let ramp = |end: f32| (0..1000).map(|index| end * index as f32 / 999.0).collect::<Vec<f32>>();
        let of =
            |values: Vec<f32>| fit("scalar_Intensity", &Column::F32(values)).map(|fit| (fit.factor, fit.is_clamped));
        assert_eq!(of(ramp(1.0)), Some((65535.0, false)));
        assert_eq!(of([ramp(1.0), vec![1.000_000_1]].concat()), Some((65535.0, false)));
        assert_eq!(of([ramp(1.0), vec![7.0, -3.0]].concat()), Some((65535.0, true)));
        assert_eq!(of(ramp(255.0)), Some((257.0, false)));
        assert_eq!(of(ramp(2048.5)), Some((1.0, false)));
        assert_eq!(of(ramp(1999.0).into_iter().map(f32::round).collect()), Some((1.0, false)));
        assert_eq!(of(ramp(70_000.0)), None);
        assert_eq!(of(ramp(-30.0)), None);
        assert_eq!(scaled(&Column::F32(vec![0.5, 1.0]), 65535.0), Column::F64(vec![32768.0, 65535.0]));
    }
}
