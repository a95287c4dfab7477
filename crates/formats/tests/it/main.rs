//! Radar descriptions, captures and recordings from outside.

mod adc;
mod adc_files;
mod bag;
mod dca1000;
mod hostile_captures;
mod hostile_recordings;
mod lint;
mod made;
mod make;
mod matlab;
mod shared_data;
mod studio;
mod ti_files;
mod ti_lines;
mod uart;
mod visualizer;
