//! How accurate a reflection is, and what it costs.
