//! What all files of an export have in common: the coordinate system, its units, and the way to count time.

use param::shown;

use super::Job;
use super::words::Words;
use crate::error::{Error, Result};
use crate::info::Info;
use crate::units::Units;

impl Job<'_> {
    /// The coordinate system of all files that have one. A file without a system may be known to have other units.
    pub(super) fn crs(&self) -> Result<Option<&str>> {
        let infos = || self.sources.iter().map(|source| source.info());
        let has_units = |info: &&Info| info.units != Units::default();
        let first = infos().find(|info| info.crs.is_some()).or_else(|| infos().find(has_units));
        let Some(first) = first else { return Ok(None) };
        let other = infos().find_map(|info| Some((info, info.system_difference(first)?)));
        if let Some((other, difference)) = other {
            let problem = format!("is in {difference} than {}", shown(&first.path));
            return Err(Error::unsuitable(&other.path, problem));
        }
        Ok(first.crs.as_deref())
    }

    /// The units of the coordinates of all files, which contradict no other, as far as some file names them.
    pub(super) fn units(&self) -> Units {
        self.sources.iter().fold(Units::default(), |units, source| units.or(source.info().units))
    }

    /// Whether times are standard time in a new LAS file: as files say of theirs, or else by the values of some. Says which
    /// files have values of the other kind.
    pub(super) fn time_of_all(&self, by_values: &[Option<bool>], words: &mut Words) -> Option<bool> {
        let told = self.sources.iter().find_map(|source| source.standard_time());
        let seen = by_values.iter().copied().flatten().max();
        let is_standard = told.or(seen)?;
        for (source, by_values) in self.sources.iter().zip(by_values) {
            if source.standard_time().is_none() && by_values.is_some_and(|own| own != is_standard) {
                let [own, new] = [!is_standard, is_standard]
                    .map(|is_standard| if is_standard { "standard time" } else { "seconds of a week" });
                let word = format!("gps_time is {own} by its values, and stays so: the new file is marked as {new}");
                words.say(&source.info().path, word);
            }
        }
        if told.is_none() && is_standard {
            words.say(self.output, "gps_time is beyond the seconds of a week: marked as standard time");
        }
        Some(is_standard)
    }
}
