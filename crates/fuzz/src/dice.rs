//! Random choices that are the same every time.

use std::cell::Cell;

use cloud::Random;

/// Draws from a sequence that the seed determines. A draw takes a shared reference, so that one draw can be an argument
/// of another.
pub struct Dice(Cell<u64>);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(Cell::new(cloud::hash(seed)))
    }

    pub fn draw(&self) -> u64 {
        let mut random = Random(self.0.get());
        let number = random.draw();
        self.0.set(random.0);
        number
    }

    /// A number below `end`; 0 if `end` is 0.
    pub fn below(&self, end: usize) -> usize {
        (self.draw() % end.max(1) as u64) as usize
    }

    pub fn one_in(&self, count: usize) -> bool {
        self.below(count) == 0
    }

    pub fn byte(&self) -> u8 {
        self.draw() as u8
    }

    /// One of `choices`, which must not be empty.
    pub fn pick<T: Copy>(&self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }
}
