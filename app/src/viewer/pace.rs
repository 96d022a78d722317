//! How the budgets of streamed clouds are divided: among what is open, and between a moving picture and one that stands still.

/// Shares of the budgets for what was opened one after the other, by the share that each would take if it had them all. What one
/// does not need goes to the others; all get the same of what is too little or too much.
pub fn shares(demands: &[f64]) -> Vec<f64> {
    // In steps, so that shares stay while a view moves a little, and enough to read a node of any size.
    const STEPS: f64 = 16.0;
    let needs: Vec<f64> = demands.iter().map(|demand| (demand * STEPS).ceil().clamp(1.0, STEPS) / STEPS).collect();
    let mut shares = vec![0.0; needs.len()];
    let mut order: Vec<usize> = (0..needs.len()).collect();
    order.sort_by(|a, b| needs[*a].total_cmp(&needs[*b]));
    let mut left = 1.0;
    for (place, index) in order.iter().enumerate() {
        shares[*index] = needs[*index].min(left / (order.len() - place) as f64);
        left -= shares[*index];
    }
    let more = left / needs.len().max(1) as f64;
    shares.iter().map(|share| share + more).collect()
}

/// How many points a frame can afford while the camera moves.
pub struct Pace {
    /// Of the point budget.
    share: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self { share: 1.0 }
    }
}

impl Pace {
    /// Below this share of the budget a frame takes its time for other things than points: sparing more would only coarsen it.
    const LEAST: f64 = 0.125;

    /// Learns from a frame of the moving camera that was to take `wanted` milliseconds. Near enough is right: each change of the
    /// budget makes points come or go.
    pub fn learn(&mut self, milliseconds: f64, wanted: f64) {
        let ratio = wanted / milliseconds.max(0.1);
        if !(0.9..1.4).contains(&ratio) {
            // Growing slowly keeps it from swinging.
            self.share = (self.share * ratio.clamp(0.5, 1.15)).clamp(Self::LEAST, 1.0);
        }
    }

    /// Points that a frame may have of a budget.
    pub fn budget(&self, points: u32) -> u32 {
        (f64::from(points) * self.share) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_go_to_who_needs_them() {
        assert_eq!(shares(&[1.0]), [1.0]);
        assert_eq!(shares(&[1.0, 1.0]), [0.5, 0.5]);
        // A small one has what it needs, not half.
        let uneven = shares(&[0.01, 1.0]);
        assert!(uneven[0] < 0.1 && uneven[1] > 0.9 && uneven.iter().sum::<f64>() <= 1.0, "{uneven:?}");
        // In whatever order; those that need too much get the same.
        let several = shares(&[1.0, 0.1, 0.8, 0.0]);
        assert!(several[0] == several[2] && several[0] > 0.4 && several[1] >= 0.1 && several[3] > 0.0, "{several:?}");
        // What nobody needs is shared evenly.
        assert_eq!(shares(&[0.0, 0.0]), [0.5, 0.5]);
        assert!(shares(&[1.0; 100]).iter().all(|share| (share - 0.01).abs() < 1e-9));
        assert!(shares(&[0.0; 100]).iter().all(|share| (share - 0.01).abs() < 1e-9));
    }

    #[test]
    fn a_moving_picture_has_as_many_points_as_its_time_allows() {
        // A millisecond for 50 thousand points, and 5 for everything else.
        let milliseconds = |points: u32| 5.0 + f64::from(points) / 50_000.0;
        let mut pace = Pace::default();
        for _ in 0..30 {
            pace.learn(milliseconds(pace.budget(5_000_000)), 40.0);
        }
        let time = milliseconds(pace.budget(5_000_000));
        assert!((28.0..45.0).contains(&time), "{time}");
        let budget = pace.budget(5_000_000);
        pace.learn(time, 40.0);
        assert_eq!(pace.budget(5_000_000), budget, "near enough is left alone");
        (0..30).for_each(|_| pace.learn(1.0, 40.0));
        assert_eq!(pace.budget(5_000_000), 5_000_000);
        (0..30).for_each(|_| pace.learn(1e9, 40.0));
        assert_eq!(pace.budget(800), 100, "never so few that nothing is left to see");
    }
}
