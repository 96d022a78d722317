//! Whether the rules that hide points have something to test: one place asks, for all commands and for the window.

use std::collections::BTreeSet;
use std::path::PathBuf;

use cloud::{Attribute, CloudLayout, ColumnType, PointTest, STRAY};
use scene::{ColorBy, Settings, SurfaceRadii, shown};

use crate::error::{Error, Result};
use crate::half_of;
use crate::input::Input;
use crate::words::Request;

/// A cloud by its name, and the attributes that it has.
pub struct Offer {
    pub cloud: String,
    pub attributes: Vec<Attribute>,
}

impl Offer {
    /// The attributes of a cloud's files, and `STRAY` where radii mark strays.
    pub fn new(cloud: String, mut attributes: Vec<Attribute>, settings: &Settings) -> Self {
        if settings.surface.radii == SurfaceRadii::Spread {
            attributes.push(Attribute { name: STRAY.into(), column_type: ColumnType::U8 });
        }
        Self { cloud, attributes }
    }
}

/// Says why no strays are shown where colours ask for them.
pub fn stray_warning(settings: &Settings) -> Option<String> {
    let is_told = settings.surface.radii == SurfaceRadii::Spread;
    let warning = || "color.by = stray: only surface.radii = spread finds strays, so all points are shown on a surface";
    (settings.color.by == ColorBy::Stray && !is_told).then(|| warning().into())
}

/// Asks whether each filter of a test, and its hidden classes, have an attribute to test. Returns a warning for each
/// cloud that lacks what others have. Without clouds there is nothing to ask.
///
/// # Errors
/// A rule that hides nothing, since no cloud has its attribute.
pub fn check_filters(test: &PointTest, clouds: &[Offer]) -> Result<Vec<String>> {
    if clouds.is_empty() {
        return Ok(Vec::new());
    }
    let mut warnings = Vec::new();
    for name in test.filtered().collect::<BTreeSet<&str>>() {
        let lacks = |offer: &&Offer| test.idle_filters(&offer.attributes).any(|idle| idle == name);
        let lacking: Vec<&Offer> = clouds.iter().filter(lacks).collect();
        if lacking.len() == clouds.len() {
            let hint = param::instead(name, names(clouds).into_iter());
            let hint = if name == STRAY { "surface.radii = spread finds it".into() } else { hint };
            return Err(Error::NoFilter(format!("{}: no attribute `{name}` to filter by; {hint}", all_of(clouds))));
        }
        let warning =
            |Offer { cloud, .. }: &&Offer| format!("{cloud}: no attribute `{name}`, so its filter hides nothing there");
        warnings.extend(lacking.iter().map(warning));
    }
    if test.hides_classes() {
        let class_column =
            |attributes: &[Attribute]| CloudLayout { attributes: attributes.to_vec(), grid: None }.class_column();
        let lacking: Vec<&Offer> = clouds.iter().filter(|offer| class_column(&offer.attributes).is_none()).collect();
        if lacking.len() == clouds.len() {
            return Err(Error::NoFilter(format!(
                "{}: no attribute `classification`, whose classes are hidden",
                all_of(clouds)
            )));
        }
        warnings.extend(lacking.iter().map(|offer| format!("{}: no classes, so none is hidden there", offer.cloud)));
    }
    Ok(warnings)
}

/// The names of the first few clouds.
fn all_of(clouds: &[Offer]) -> String {
    param::few(clouds.iter().map(|offer| offer.cloud.clone()).collect(), "clouds").join(", ")
}

/// The names of all attributes, each once, in the order in which they come.
fn names(clouds: &[Offer]) -> Vec<&str> {
    let mut known = BTreeSet::new();
    let all = clouds.iter().flat_map(|offer| &offer.attributes).map(|attribute| attribute.name.as_str());
    all.filter(|name| known.insert(*name)).collect()
}

impl Request {
    /// Checks the filters against all inputs, of whose files the heads are read. Inputs that cannot be read are
    /// reported by those who read them.
    ///
    /// # Errors
    /// Those of `check_filters`.
    pub fn check_filters(&self, settings: &Settings) -> Result<Vec<String>> {
        let memory = half_of(settings.stream.host_bytes);
        let test = self.test();
        if !test.tests_attributes() {
            return Ok(Vec::new());
        }
        let of_file = |source: codec::Source| {
            let codec::Info { path, attributes, .. } = source.info();
            Offer::new(shown(path), attributes.clone(), settings)
        };
        let open = |file: &PathBuf| codec::open_scans(file, memory).unwrap_or_default();
        let files = self.inputs.iter().flat_map(Input::files);
        let of_files = files.flat_map(open).map(of_file);
        let built_in = self.inputs.iter().filter(|input| matches!(input, Input::BuiltIn { .. }));
        let built_in = built_in.map(|input| Offer::new(input.name(), Vec::new(), settings));
        let warnings = check_filters(&test, &of_files.chain(built_in).collect::<Vec<_>>())?;
        Ok(param::few(warnings, "filters that hide nothing of a cloud"))
    }
}

#[cfg(test)]
mod tests {
    use cloud::{ColumnType, Filter};

    use super::*;

    fn offer(cloud: &str, names: &[&str]) -> Offer {
        let attribute = |name: &&str| Attribute { name: (*name).into(), column_type: ColumnType::U8 };
        Offer { cloud: cloud.into(), attributes: names.iter().map(attribute).collect() }
    }

    fn filtering(attribute: &str) -> PointTest {
        PointTest::new([], vec![Filter { attribute: attribute.into(), low: 0.0, high: 1.0 }], Vec::new())
    }

    #[test]
    fn a_filter_that_no_cloud_knows_is_refused_and_one_that_some_lack_is_said() {
        let both = [offer("a.las", &["withheld", "z"]), offer("b.ply", &["z"])];
        assert!(check_filters(&filtering("z"), &both).unwrap().is_empty());
        let lacks = "b.ply: no attribute `withheld`, so its filter hides nothing there";
        assert_eq!(check_filters(&filtering("withheld"), &both).unwrap(), [lacks]);
        let refused = check_filters(&filtering("witheld"), &both).unwrap_err();
        let expected = "a.las, b.ply: no attribute `witheld` to filter by; did you mean `withheld`? Known: withheld, z";
        assert_eq!((refused.to_string().as_str(), refused.is_usage()), (expected, true));
        let nothing = check_filters(&filtering("z"), &[offer("five-mirrors/none", &[])]).unwrap_err().to_string();
        assert_eq!(nothing, "five-mirrors/none: no attribute `z` to filter by; there is none");
        assert!(check_filters(&filtering("withheld"), &[]).unwrap().is_empty());
        assert!(check_filters(&PointTest::default(), &both).unwrap().is_empty());
    }

    #[test]
    fn strays_can_be_filtered_where_radii_tell_them() {
        let offer = |radii: SurfaceRadii| {
            let mut settings = Settings::default();
            settings.surface.radii = radii;
            [Offer::new("a.las".into(), Vec::new(), &settings)]
        };
        assert!(check_filters(&filtering(STRAY), &offer(SurfaceRadii::Spread)).unwrap().is_empty());
        let refused = check_filters(&filtering(STRAY), &offer(SurfaceRadii::Full)).unwrap_err().to_string();
        assert_eq!(refused, "a.las: no attribute `stray` to filter by; surface.radii = spread finds it");
    }

    #[test]
    fn hidden_classes_need_a_cloud_with_classes() {
        let hiding = PointTest::hiding([7]);
        let both = [offer("a.las", &["classification"]), offer("b.ply", &["x"])];
        assert!(check_filters(&hiding, &both[..1]).unwrap().is_empty());
        assert_eq!(check_filters(&hiding, &both).unwrap(), ["b.ply: no classes, so none is hidden there"]);
        let refused = check_filters(&hiding, &both[1..]).unwrap_err().to_string();
        assert_eq!(refused, "b.ply: no attribute `classification`, whose classes are hidden");
    }
}
