//! The virtual radar: moving triangles in, FMCW radar cubes out.
