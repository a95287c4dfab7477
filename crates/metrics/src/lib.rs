//! Caption metrics with confidence intervals, over plain slices.
