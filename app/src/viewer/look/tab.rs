//! The tabs of the side panel. A section of the parameter tables belongs to one of them.

use crate::shared::language::{english, text};

/// A tab of the side panel, in the order of the row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tab {
    #[default]
    Data,
    Look,
    Light,
    Mirrors,
    Measure,
    Tuning,
    Streaming,
}

impl Tab {
    pub const ALL: [Self; 7] =
        [Self::Data, Self::Look, Self::Light, Self::Mirrors, Self::Measure, Self::Tuning, Self::Streaming];

    /// The name that people read, and by which the preferences remember the tab.
    pub fn name(self) -> &'static str {
        match self {
            Self::Data => english!("Data"),
            Self::Look => english!("Look"),
            Self::Light => english!("Light"),
            Self::Mirrors => english!("Mirrors"),
            Self::Measure => english!("Measure"),
            Self::Tuning => english!("Tuning"),
            Self::Streaming => english!("Streaming"),
        }
    }

    /// What is found in the tab, in a line.
    pub fn help(self) -> &'static str {
        match self {
            Self::Data => text!("Clouds, clip volumes and filters, how files are read"),
            Self::Look => text!("Colours, splats, the view and its overlays"),
            Self::Light => text!("Lamps, sun and sky, indirect light, tones"),
            Self::Mirrors => text!("Mirrors: their places, shapes and surfaces, and points that reflect"),
            Self::Measure => text!("Measurements, notes and profiles"),
            Self::Tuning => {
                text!("How reflections are found: method, presets, parameters, sweeps, chart, truth and times")
            }
            Self::Streaming => text!("Clouds larger than memory: indexes and budgets"),
        }
    }

    /// The tab of this name; the first one if there is none.
    pub fn named(name: &str) -> Self {
        Self::ALL.into_iter().find(|tab| tab.name() == name).unwrap_or_default()
    }

    /// The tab that shows a section of the parameter tables.
    pub fn of_section(section: &str) -> Self {
        match section {
            "When loading" => Self::Data,
            "Light" => Self::Light,
            "Reflections" | "Truth" => Self::Tuning,
            "When streaming" => Self::Streaming,
            _ => Self::Look,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tab_is_remembered_by_its_name_and_an_unknown_name_is_the_first_tab() {
        for tab in Tab::ALL {
            assert_eq!(Tab::named(tab.name()), tab);
        }
        assert_eq!(Tab::named("gone"), Tab::Data);
    }
}
