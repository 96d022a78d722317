//! The methods whose parameters a picture reads.

use crate::{CubeRest, Method, SampleRest, ScreenRest, Settings};

impl Settings {
    /// The groups of parameters that a picture's methods read: those of `reflection.method`, of the `own` methods of
    /// mirrors, and of the methods whose passes these use.
    pub fn groups_of_methods(&self, own: &[Option<Method>]) -> Vec<&'static str> {
        let own = if self.reflection.method == Method::None { &[] } else { own };
        let methods = own.iter().chain([&None]).map(|own| self.reflection.method_of(*own));
        let all = methods.flat_map(|method| std::iter::successors(Some(method), |method| self.used_by(*method)));
        all.filter_map(|method| method.row().group).collect()
    }

    /// The method whose passes, and so whose parameters, another one uses.
    fn used_by(&self, method: Method) -> Option<Method> {
        let finds_the_rest = match method {
            // Its splats are averaged and closed by the passes of sscr.
            Method::SampleCameras => return Some(Method::Sscr),
            Method::ScreenTrace if self.screen_trace.rest == ScreenRest::CubemapTrace => {
                return Some(Method::CubemapTrace);
            }
            Method::ScreenTrace => self.screen_trace.rest == ScreenRest::EnvironmentMap,
            Method::CubemapTrace => self.cubemap_trace.rest == CubeRest::EnvironmentMap,
            Method::LightField => self.light_field.rest == SampleRest::EnvironmentMap,
            _ => false,
        };
        finds_the_rest.then_some(Method::EnvironmentMap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_read_by_the_method_by_mirrors_with_their_own_and_by_what_these_use() {
        let mut settings = Settings::default();
        let own = [None, Some(Method::Sscr)];
        assert_eq!(settings.groups_of_methods(&own), ["sscr"]);
        settings.reflection.method = Method::ScreenTrace;
        settings.screen_trace.rest = ScreenRest::EnvironmentMap;
        assert_eq!(settings.groups_of_methods(&[]), ["screen_trace", "environment_map"]);
        settings.screen_trace.rest = ScreenRest::SurfelTrace;
        assert_eq!(settings.groups_of_methods(&own), ["screen_trace", "sscr", "screen_trace"]);
        let others = [Some(Method::SampleCameras), Some(Method::CubemapTrace), Some(Method::LightField)];
        settings.cubemap_trace.rest = CubeRest::EnvironmentMap;
        settings.light_field.rest = SampleRest::EnvironmentMap;
        let read = settings.groups_of_methods(&others);
        assert_eq!(read[..2], ["sample_cameras", "sscr"]);
        assert_eq!(read[2..6], ["cubemap_trace", "environment_map", "light_field", "environment_map"]);
        settings.reflection.own_methods = false;
        assert!(!settings.groups_of_methods(&own).contains(&"sscr"));
        (settings.reflection.method, settings.reflection.own_methods) = (Method::None, true);
        assert!(settings.groups_of_methods(&own).is_empty());
    }
}
