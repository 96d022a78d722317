//! What surrounds the points in the window. A worker thread finds it out whenever the visible points change.

use world::AutoLight;

#[derive(Default)]
pub struct LightSearch {
    /// The result of the last valid answer.
    pub light: AutoLight,
    /// The number of questions asked, and the number of the last question that was answered.
    asked: u32,
    known: u32,
}

impl LightSearch {
    /// Returns the number of a new question. Answers to earlier questions are no longer valid.
    pub fn ask(&mut self) -> u32 {
        self.asked += 1;
        self.asked
    }

    /// Stores an answer if it is valid; returns whether it is.
    pub fn answer(&mut self, asked: u32, light: AutoLight) -> bool {
        let counts = asked == self.asked;
        if counts {
            (self.known, self.light) = (asked, light);
        }
        counts
    }

    /// Discards the answer when no cloud is open. A pending answer is about points that are gone.
    pub fn forget(&mut self) {
        self.asked += 1;
        (self.known, self.light) = (self.asked, AutoLight::default());
    }

    /// Whether every question is answered.
    pub fn is_known(&self) -> bool {
        self.known == self.asked
    }
}
