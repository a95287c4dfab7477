//! Radar cubes in, points out: range, Doppler, clutter, angle, point selection.
