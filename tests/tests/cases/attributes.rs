//! Bit fields as attributes, filters that name nothing, values that are no value.
