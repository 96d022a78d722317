//! Into how many pieces a long pass is cut: between them a frame may be given up, and systems take a GPU for stuck that
//! works on one of them for seconds.

/// The most pieces of a pass where each is submitted and waited for.
const MOST_PIECES: f64 = 64.0;
/// The most pieces of a pass on a GPU.
const MOST_PIECES_OF_GPU: f64 = 4096.0;
/// The milliseconds that a dispatch, and all that is submitted together, are meant to take at most on a GPU: systems take
/// a GPU for stuck after two seconds or more, and what an earlier frame took is no promise.
pub(crate) const LONGEST_ON_GPU: f64 = 50.0;
/// The most milliseconds of work that is submitted ahead of the GPU where a frame may be given up.
pub(crate) const MOST_AHEAD: f64 = 200.0;
/// The milliseconds above which a dispatch is refused on a GPU.
pub(crate) const TOO_LONG: f64 = 2000.0;
/// A piece of a pass that nobody has timed yet has this many workgroups at a load of 1 where there are more, and so many of
/// these pieces, or of whole passes, are submitted together. By the times that are computed for each pass (docs/gpu.md),
/// none takes longer than 100 ms.
const GROUPS_OF_UNKNOWN: f64 = 256.0;
pub(crate) const UNKNOWN_TOGETHER: f64 = 8.0;

/// Into how many pieces a pass of `groups` workgroups is cut so that none takes longer than `longest` milliseconds, if
/// a workgroup takes `each`; `None` if nobody knows. `load` is that of the pass (`Pass::load`).
pub(crate) fn pieces_of(each: Option<f64>, load: f64, groups: f64, longest: f64, is_watched: bool) -> u32 {
    let most = if is_watched { MOST_PIECES_OF_GPU } else { MOST_PIECES };
    let pieces = match each {
        Some(each) => each * groups / longest,
        None if is_watched => groups * load.max(1.0) / GROUPS_OF_UNKNOWN,
        None => 1.0,
    };
    pieces.ceil().clamp(1.0, most) as u32
}

/// The columns and rows of workgroups of each piece, but the last ones, if a pass of so many is cut into about `pieces`:
/// whole rows as long as these are enough.
pub(crate) fn piece_of([columns, rows]: [u32; 2], pieces: u32) -> [u32; 2] {
    let parts = if pieces > rows { pieces.div_ceil(rows.max(1)) } else { 1 };
    [columns.div_ceil(parts).max(1), rows.div_ceil(pieces).max(1)]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The workgroups of the longest dispatch of a pass of so many columns and rows, if a workgroup is known to take `each`,
    /// or if nobody knows.
    pub(crate) fn longest_dispatch(each: Option<f64>, load: f64, groups: [u32; 2]) -> f64 {
        let pieces = pieces_of(each, load, groups.map(f64::from).iter().product(), LONGEST_ON_GPU, true);
        piece_of(groups, pieces).map(f64::from).iter().product()
    }

    #[test]
    fn passes_are_cut_by_rows_and_then_by_columns_without_a_gap() {
        assert_eq!(piece_of([480, 270], 1), [480, 270]);
        assert_eq!(piece_of([480, 270], 4), [480, 68]);
        assert_eq!(piece_of([480, 270], 270), [480, 1]);
        assert_eq!(piece_of([480, 270], 271), [240, 1]);
        assert_eq!(piece_of([480, 270], 4096), [30, 1]);
        assert_eq!(piece_of([1, 1], 4096), [1, 1]);
        // Neither short passes nor those of software are cut without need.
        assert_eq!(pieces_of(Some(1e-4), 1.0, 129_600.0, LONGEST_ON_GPU, true), 1);
        assert_eq!(pieces_of(None, 1.0, 250.0, LONGEST_ON_GPU, true), 1);
        assert_eq!(pieces_of(None, 9.0, 129_600.0, 25.0, false), 1);
        // What nobody has timed goes in smaller pieces where settings ask for more.
        assert_eq!(pieces_of(None, 4.0, 256.0, LONGEST_ON_GPU, true), 4);
    }
}
