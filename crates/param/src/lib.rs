//! One definition of each parameter.
//!
//! A `params!` block gives a plain struct with defaults and a table of its fields: name, help, unit, range, default.
//! Flags, panels, session files, undo, `glint methods`, the WGSL structs and docs/parameters.md all read that table;
//! nothing else repeats a name, a range or a default.

mod field;
mod path_text;
mod value;

pub use field::{
    Affects, Error, Field, Group, Kind, MOST_QUOTED, Params, Uses, differing, few, instead, nearest, shortened,
};
pub use path_text::shown;
pub use value::{Bytes, Choice, Color, Type, Value};

/// Declares parameter groups. A group says in which section of the panel it is shown and what its parameters affect. Each field is
/// one line: name, type, default and, for numbers, range and unit; then, where it differs from the group, what it affects, and
/// whether it is `not(kept)` as a preference or `not(swept)`.
///
/// ```
/// param::choices! {
///     /// How much care is taken.
///     pub enum Quality { Fast = "fast", Best = "best" }
/// }
/// param::params! {
///     /// How points become splats.
///     pub struct Splat = "splat" in "Splats" => affects(found truth) {
///         /// Radius relative to the spacing of the points.
///         size: f32 = 1.0, 0.1..=10.0, "x spacing";
///         /// How much care is taken.
///         quality: Quality = Quality::Best => affects(found) not(kept);
///     }
/// }
/// use param::Params as _;
/// let mut splat = Splat::default();
/// splat.set_text("size", "2.5").unwrap();
/// assert_eq!(splat.size, 2.5);
/// assert!(splat.set_text("size", "99").unwrap_err().to_string().contains("0.1 to 10"));
/// let [size, quality] = &Splat::table().fields[..] else { panic!() };
/// assert!(size.affects.truth && size.uses.kept && !quality.affects.truth && !quality.uses.kept);
/// ```
#[macro_export]
macro_rules! params {
    ($(
        $(#[doc = $group_help:literal])*
        pub struct $Group:ident = $group:literal in $section:literal
            => affects($($all_affect:ident)*) $(not($($none_is:ident)+))? {
            $(
                $(#[doc = $help:literal])*
                $name:ident: $Type:ty = $default:expr $(, $range:expr, $unit:literal)?
                    $(=> $(affects($($affects:ident)*))? $(not($($is_not:ident)+))?)? ;
            )*
        }
    )*) => {$(
        $(#[doc = $group_help])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $Group { $( $(#[doc = $help])* pub $name: $Type, )* }

        impl Default for $Group {
            fn default() -> Self {
                Self { $( $name: $default, )* }
            }
        }

        impl $Group {
            /// The table of this group.
            pub fn table() -> &'static $crate::Group {
                static TABLE: std::sync::OnceLock<$crate::Group> = std::sync::OnceLock::new();
                #[allow(unused_mut)]
                let (mut affects, mut uses) = ($crate::Affects::default(), $crate::Uses::default());
                $(affects.$all_affect = true;)*
                $($(uses.$none_is = false;)+)?
                TABLE.get_or_init(|| $crate::Group {
                    name: $group,
                    help: concat!($($group_help),*).trim_start(),
                    section: $section,
                    fields: vec![$( $crate::Field {
                        name: stringify!($name),
                        help: concat!($($help),*).trim_start(),
                        unit: concat!($($unit)?),
                        kind: {
                            #[allow(unused_mut, unused_assignments)]
                            let mut range: Option<std::ops::RangeInclusive<$Type>> = None;
                            $( range = Some($range); )?
                            <$Type as $crate::Type>::kind($default, range)
                        },
                        affects: {
                            #[allow(unused_mut, unused_assignments)]
                            let mut own = affects;
                            $($(
                                own = $crate::Affects::default();
                                $(own.$affects = true;)*
                            )?)?
                            own
                        },
                        uses: {
                            #[allow(unused_mut)]
                            let mut own = uses;
                            $($($(own.$is_not = false;)+)?)?
                            own
                        },
                    }, )*],
                })
            }
        }

        impl $crate::Params for $Group {
            fn group(&self) -> &'static $crate::Group {
                Self::table()
            }
            fn values(&self) -> Vec<$crate::Value> {
                vec![$( $crate::Type::to_value(&self.$name), )*]
            }
            fn set_values(&mut self, values: &[$crate::Value]) {
                let mut values = values.iter();
                $( if let Some(value) = values.next().and_then(<$Type as $crate::Type>::from_value) { self.$name = value; } )*
            }
        }
    )*};
}

/// Declares the struct of all parameters: a field for each group, and the lists of them.
#[macro_export]
macro_rules! settings {
    ($(#[doc = $help:literal])* pub struct $Settings:ident { $($field:ident: $Group:ident),* $(,)? }) => {
        $(#[doc = $help])*
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $Settings { $(pub $field: $Group),* }

        impl $Settings {
            /// The number of groups.
            pub const GROUPS: usize = [$(stringify!($field)),*].len();

            /// The groups, in order.
            pub fn groups(&self) -> [&dyn $crate::Params; Self::GROUPS] {
                [$(&self.$field),*]
            }

            /// The groups, in order.
            pub fn groups_mut(&mut self) -> [&mut dyn $crate::Params; Self::GROUPS] {
                let Self { $($field),* } = self;
                [$($field),*]
            }
        }
    };
}

/// Declares an enum whose variants are the choices of a parameter, each with the name that people type.
#[macro_export]
macro_rules! choices {
    ($( #[doc = $help:literal] )* pub enum $Enum:ident { $( $Variant:ident = $name:literal ),* $(,)? }) => {
        $( #[doc = $help] )*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd)]
        #[repr(u32)]
        pub enum $Enum { $( $Variant ),* }

        impl $crate::Choice for $Enum {
            const NAMES: &'static [&'static str] = &[$( $name ),*];
            fn index(self) -> u32 {
                self as u32
            }
            fn from_index(index: u32) -> Option<Self> {
                [$( Self::$Variant ),*].get(index as usize).copied()
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    choices! {
        /// How much care is taken.
        pub enum Quality { Fast = "fast", Best = "best" }
    }
    params! {
        /// How points become splats.
        pub struct Splat = "splat" in "Splats" => affects(found truth) not(swept) {
            /// Radius relative to the spacing of the points.
            size: f32 = 1.0, 0.1..=10.0, "x spacing" => affects(points);
            /// Steps of the march.
            steps: u32 = 48, 1..=512, "steps" => not(kept);
            /// How much care is taken.
            quality: Quality = Quality::Best;
            /// Whether it is on.
            on: bool = true;
            /// Colour behind everything.
            background: Color = Color(0x1a1c_20ff);
            /// Memory it may take.
            memory: Bytes = Bytes(1 << 30), Bytes(1 << 20)..=Bytes(1 << 40), "";
            /// Attribute to show.
            attribute: String = String::new();
        }
    }

    #[test]
    fn defaults_come_from_the_table() {
        let splat = Splat::default();
        for (field, value) in Splat::table().fields.iter().zip(splat.values()) {
            assert_eq!(field.default(), value, "{}", field.name);
        }
    }

    #[test]
    fn what_is_long_or_many_is_told_in_short() {
        assert_eq!(shortened("short", 80), "short");
        let long = format!("begin{}end", "x".repeat(1_000_000));
        let told = shortened(&long, MOST_QUOTED);
        assert!(told.starts_with("begin") && told.contains("...") && told.ends_with("end"), "{told}");
        assert_eq!(told.chars().count(), MOST_QUOTED);
        for (key, value) in [(long.as_str(), "1"), ("size", long.as_str()), ("quality", long.as_str())] {
            let message = Splat::default().set_text(key, value).unwrap_err().to_string();
            assert!(message.len() < 200, "{} bytes: {message}", message.len());
        }
        let messages = |count: usize| few((0..count).map(|index| index.to_string()).collect(), "numbers");
        assert_eq!(messages(4), ["0", "1", "2", "3"]);
        assert_eq!(messages(20_000), ["0", "1", "2", "and 19997 more numbers"]);
    }

    #[test]
    fn a_field_takes_what_its_group_says_unless_it_says_otherwise() {
        let [size, steps, quality, ..] = &Splat::table().fields[..] else { panic!("no fields") };
        let of_group = Affects { found: true, truth: true, ..Affects::default() };
        assert_eq!([size.affects, steps.affects], [Affects { points: true, ..Affects::default() }, of_group]);
        assert_eq!(steps.uses, Uses { kept: false, swept: false });
        assert_eq!((quality.affects, quality.uses), (of_group, Uses { kept: true, swept: false }));
        assert_eq!(Splat::table().section, "Splats");
    }

    #[test]
    fn every_value_survives_text_and_back() {
        let splat = Splat {
            size: 0.3,
            steps: 7,
            quality: Quality::Fast,
            on: false,
            background: Color(0x0102_03ff),
            memory: Bytes((1 << 20) + 1),
            attribute: "a b".into(),
        };
        let mut back = Splat::default();
        for (field, value) in Splat::table().fields.iter().zip(splat.values()) {
            back.set_text(field.name, &field.format(&value)).unwrap();
        }
        assert_eq!(back, splat);
    }

    #[test]
    fn out_of_range_and_misspelt_values_are_refused_by_name() {
        let mut splat = Splat::default();
        let message = |result: Result<(), Error>| result.unwrap_err().to_string();
        assert_eq!(message(splat.set_text("steps", "0")), "splat.steps: 0 is out of range, expected 1 to 512 steps");
        assert_eq!(
            message(splat.set_text("steps", "x")),
            "splat.steps: `x` is not a whole number, expected 1 to 512 steps"
        );
        assert_eq!(
            message(splat.set_text("size", "NaN")),
            "splat.size: NaN is out of range, expected 0.1 to 10 x spacing"
        );
        assert_eq!(message(splat.set_text("quality", "worst")), "splat.quality: `worst` is none of fast, best");
        assert_eq!(
            message(splat.set_text("stops", "1")),
            "splat.stops: no such parameter; did you mean `splat.steps`?"
        );
        assert_eq!(splat, Splat::default());
    }

    #[test]
    fn amounts_of_memory_are_read_and_written_in_binary_units() {
        let written = |bytes: u64| Bytes(bytes).to_string();
        assert_eq!(
            [0, 1000, 1024, 1536 << 20, 4 << 30, u64::MAX].map(written),
            ["0B", "1000B", "1KiB", "1536MiB", "4GiB", "18446744073709551615B"]
        );
        let read = |text: &str| text.parse::<Bytes>().ok().map(|bytes| bytes.0);
        for (text, bytes) in
            [("1GiB", 1 << 30), ("512 MiB", 512 << 20), ("1.5GiB", 3 << 29), (" 7 ", 7), ("3 kib", 3072), ("2B", 2)]
        {
            assert_eq!(read(text), Some(bytes), "{text}");
        }
        for wrong in ["", "GiB", "-1", "1GB", "1 GiB or so", "NaN", "inf", "1e30", "99999EiB", "17EiB"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
        let mut splat = Splat::default();
        splat.set_text("memory", "1.5 GiB").unwrap();
        assert_eq!(splat.memory, Bytes(3 << 29));
        let message = |result: Result<(), Error>| result.unwrap_err().to_string();
        assert_eq!(
            message(splat.set_text("memory", "1KiB")),
            "splat.memory: 1KiB is out of range, expected 1MiB to 1TiB"
        );
        assert_eq!(
            message(splat.set_text("memory", "much")),
            "splat.memory: `much` is not an amount like 512MiB, expected 1MiB to 1TiB"
        );
        assert!(Splat::table().fields.iter().any(|field| field.name == "memory" && field.is_logarithmic()));
    }

    #[test]
    fn the_wgsl_struct_holds_one_word_a_field_and_skips_text_and_memory() {
        let splat = Splat::default();
        assert_eq!(splat.words(), vec![1.0_f32.to_bits(), 48, 1, 1, 0x1a1c_20ff]);
        let wgsl = Splat::table().wgsl();
        assert!(wgsl.contains("struct Splat {"), "{wgsl}");
        assert!(
            wgsl.contains("    size: f32,\n    steps: u32,\n    quality: u32,\n    on: u32,\n    background: u32,\n}"),
            "{wgsl}"
        );
        assert!(wgsl.contains("const SPLAT_QUALITY_BEST: u32 = 1u;"), "{wgsl}");
    }

    #[test]
    fn only_what_differs_from_the_defaults_is_listed() {
        let splat = Splat { steps: 9, ..Splat::default() };
        assert_eq!(differing(&splat), vec![("splat.steps".to_string(), Value::U32(9))]);
    }
}
