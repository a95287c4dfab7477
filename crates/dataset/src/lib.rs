//! Radar-text data sets on disk: Parquet schema, shards, manifest, validation.
pub mod record;
