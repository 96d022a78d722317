//! What is around the points of the window: asked whenever other points are shown, and answered by a worker thread.

use world::AutoLight;

#[derive(Default)]
pub struct LightSearch {
    /// By the last answer that counts.
    pub light: AutoLight,
    /// How often it was asked, and the last question that was answered.
    asked: u32,
    known: u32,
}

impl LightSearch {
    /// The number of a new question. Answers to earlier ones no longer count.
    pub fn ask(&mut self) -> u32 {
        self.asked += 1;
        self.asked
    }

    /// Takes in an answer; whether it counts.
    pub fn answer(&mut self, asked: u32, light: AutoLight) -> bool {
        let counts = asked == self.asked;
        if counts {
            (self.known, self.light) = (asked, light);
        }
        counts
    }

    /// Nothing is shown any more. An answer that is under way is about what is gone.
    pub fn forget(&mut self) {
        self.asked += 1;
        (self.known, self.light) = (self.asked, AutoLight::default());
    }

    /// Whether every question is answered.
    pub fn is_known(&self) -> bool {
        self.known == self.asked
    }
}
