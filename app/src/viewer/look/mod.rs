//! What panels are drawn with: colours, widgets, tabs, and numbers as text.

pub mod reflection_figures;
pub mod tab;
pub mod theme;
pub mod typed;
pub mod widgets;
