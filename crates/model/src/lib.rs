//! The radar tokenizer (Aggregate VQ-VAE) and the radar-language model (T5).
