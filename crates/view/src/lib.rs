//! Pictures and the self-contained page: points over time, mesh, range-Doppler, PNG.
