//! Radar descriptions and captures from outside.

mod adc;
mod adc_files;
mod dca1000;
mod hostile;
mod lint;
mod made;
mod studio;
mod ti_files;
mod ti_lines;
