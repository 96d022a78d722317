//! Files that other programs open, and merges that lose nothing.
