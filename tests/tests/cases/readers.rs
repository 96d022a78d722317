//! Colours, origins and names of files that other programs wrote.
