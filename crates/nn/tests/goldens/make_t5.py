"""Golden weights and logits of two tiny random T5s, from Hugging Face's own FlaxT5.

    pip install jax==0.4.38 flax==0.10.2 transformers==4.46.3 "numpy<2.2" safetensors
    python make_t5.py .

Writes t5_v10.safetensors (ReLU, tied) and t5_v11.safetensors (gated GELU, untied): the weights
under their PyTorch checkpoint names and layout (Linear as [out, in]), `config` as JSON metadata,
and `input_ids`, `attention_mask`, `decoder_input_ids`, `logits`, all f32. The decoder is 40 steps long and
the source 24, so that position buckets beyond the exact range (distance 8 in the encoder, 16 in
the decoder) take part, and one source is padded.
"""

import json
import sys

import jax
import numpy as np
from safetensors.numpy import save_file
from transformers import FlaxT5ForConditionalGeneration, T5Config

jax.config.update("jax_default_matmul_precision", "highest")


def torch_names(tree, prefix=""):
    """Flax parameter tree -> PyTorch names; kernels transposed to [out, in]."""
    out = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            out.update(torch_names(value, f"{prefix}{key}."))
            continue
        value = np.asarray(value)
        name = {"kernel": "weight", "embedding": "weight"}.get(key, key)
        out[prefix + name] = np.ascontiguousarray(value.T if key == "kernel" else value)
    return out


def make(path, projection, tied, seed):
    config = T5Config(
        vocab_size=40, d_model=16, d_kv=6, num_heads=2, d_ff=24, num_layers=2,
        num_decoder_layers=2, feed_forward_proj=projection, tie_word_embeddings=tied,
        dropout_rate=0.0, decoder_start_token_id=0, pad_token_id=0, eos_token_id=1,
    )
    model = FlaxT5ForConditionalGeneration(config, seed=seed)
    rng = np.random.default_rng(seed)
    # Norm gains away from one and larger weights, so that nothing can hide behind the initial values.
    params = jax.tree_util.tree_map(
        lambda p: np.asarray(p) * (1 + 0.3 * rng.standard_normal(p.shape)).astype(np.float32)
        + (0.1 * rng.standard_normal(p.shape)).astype(np.float32),
        model.params,
    )
    input_ids = rng.integers(2, 40, (2, 24)).astype(np.int32)
    mask = np.ones((2, 24), np.int32)
    mask[1, 17:] = 0
    input_ids[1, 17:] = 0
    decoder_input_ids = rng.integers(2, 40, (2, 40)).astype(np.int32)
    decoder_input_ids[:, 0] = 0
    logits = model(
        input_ids=input_ids, attention_mask=mask, decoder_input_ids=decoder_input_ids, params=params
    ).logits
    tensors = {k: v.astype(np.float32) for k, v in torch_names(params).items()}
    tensors |= {
        "input_ids": input_ids.astype(np.float32), "attention_mask": mask.astype(np.float32),
        "decoder_input_ids": decoder_input_ids.astype(np.float32),
        "logits": np.asarray(logits, np.float32),
    }
    save_file(tensors, path, metadata={"config": json.dumps(config.to_dict())})


if __name__ == "__main__":
    make(f"{sys.argv[1]}/t5_v10.safetensors", "relu", True, 1)
    make(f"{sys.argv[1]}/t5_v11.safetensors", "gated-gelu", False, 2)
