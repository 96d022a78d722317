//! Units and coordinate systems, and clouds that lie far apart.
