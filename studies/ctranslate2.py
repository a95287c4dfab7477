"""Speed of CTranslate2 on a T5-small with random weights: 64 tokens in, exactly 40 out, greedy.

    pip install numpy safetensors ctranslate2
    python ctranslate2.py FOLDER [int8|float32]

Times are those on the CPU, of all threads.

Writes FOLDER/config.json and FOLDER/model.safetensors (Hugging Face layout, weights from a fixed seed)
and the converted model beside them, unless they are there. The bench `bench_engine` of crates/engine
reads the same folder; docs/results/engine.md has the figures.
"""

import json
import statistics
import sys
import time
from pathlib import Path

# This file is named after the package it runs: the package must be found, not the file.
sys.path = [p for p in sys.path if Path(p or ".").resolve() != Path(__file__).resolve().parent]
import ctranslate2
import numpy as np
from ctranslate2.specs import common_spec, transformer_spec
from safetensors.numpy import load_file, save_file

CONFIG = {
    "model_type": "t5", "vocab_size": 32128, "d_model": 512, "d_kv": 64, "d_ff": 2048, "num_layers": 6,
    "num_decoder_layers": 6, "num_heads": 8, "relative_attention_num_buckets": 32,
    "relative_attention_max_distance": 128, "layer_norm_epsilon": 1e-6, "feed_forward_proj": "relu",
    "tie_word_embeddings": True,
}
SOURCE, NEW, RUNS = 64, 40, 9


def draw():
    """Weights with the spread that training starts from, [out, in]."""
    rng = np.random.default_rng(1)
    d, inner, ff = CONFIG["d_model"], CONFIG["num_heads"] * CONFIG["d_kv"], CONFIG["d_ff"]
    out = {}

    def add(name, shape, std):
        out[name + ".weight"] = (rng.standard_normal(shape) * std).astype(np.float32)

    # Small, so that the layers decide what is said; with 1, as in training, the first token repeats itself.
    add("shared", (CONFIG["vocab_size"], d), 0.05)
    for stack in ("encoder", "decoder"):
        out[f"{stack}.final_layer_norm.weight"] = np.ones(d, np.float32)
        for i in range(CONFIG["num_layers"]):
            names = ["SelfAttention"] + (["EncDecAttention"] if stack == "decoder" else [])
            for layer, name in enumerate(names):
                prefix = f"{stack}.block.{i}.layer.{layer}"
                out[f"{prefix}.layer_norm.weight"] = np.ones(d, np.float32)
                add(f"{prefix}.{name}.q", (inner, d), (d * CONFIG["d_kv"]) ** -0.5)
                add(f"{prefix}.{name}.k", (inner, d), d**-0.5)
                add(f"{prefix}.{name}.v", (inner, d), d**-0.5)
                add(f"{prefix}.{name}.o", (d, inner), inner**-0.5)
                if i == 0 and layer == 0:
                    add(f"{prefix}.{name}.relative_attention_bias", (32, CONFIG["num_heads"]), d**-0.5)
            prefix = f"{stack}.block.{i}.layer.{len(names)}"
            out[f"{prefix}.layer_norm.weight"] = np.ones(d, np.float32)
            add(f"{prefix}.DenseReluDense.wi", (ff, d), d**-0.5)
            add(f"{prefix}.DenseReluDense.wo", (d, ff), ff**-0.5)
    return out


def convert(weights, folder, quantization):
    """CTranslate2's model of these weights; what its converter does, without PyTorch."""
    n = CONFIG["num_layers"]
    spec = transformer_spec.TransformerSpec.from_config(
        (n, n), CONFIG["num_heads"], pre_norm=True, activation=common_spec.Activation.RELU,
        relative_attention_bias=True, rms_norm=True,
    )
    shared = weights["shared.weight"]
    for stack in ("encoder", "decoder"):
        part = getattr(spec, stack)
        part.layer_norm.gamma = weights[f"{stack}.final_layer_norm.weight"]
        embeddings = part.embeddings[0] if isinstance(part.embeddings, list) else part.embeddings
        embeddings.weight = shared
        part.scale_embeddings = False
        bias = weights[f"{stack}.block.0.layer.0.SelfAttention.relative_attention_bias.weight"]
        for i, layer in enumerate(part.layer):
            prefix = f"{stack}.block.{i}.layer"

            def take(name):
                return weights[f"{prefix}.{name}.weight"]

            attentions = [(layer.self_attention, 0, "SelfAttention")]
            if stack == "decoder":
                attentions.append((layer.attention, 1, "EncDecAttention"))
            for attention, at, name in attentions:
                attention.queries_scale = 1.0
                attention.layer_norm.gamma = take(f"{at}.layer_norm")
                q, k, v = (take(f"{at}.{name}.{x}") for x in "qkv")
                if at == 0:
                    attention.linear[0].weight = np.concatenate([q, k, v])
                    attention.relative_attention_bias = bias
                    attention.relative_attention_max_distance = np.dtype("int32").type(128)
                else:
                    attention.linear[0].weight = q
                    attention.linear[1].weight = np.concatenate([k, v])
                attention.linear[-1].weight = take(f"{at}.{name}.o")
            at = len(attentions)
            layer.ffn.layer_norm.gamma = take(f"{at}.layer_norm")
            layer.ffn.linear_0.weight = take(f"{at}.DenseReluDense.wi")
            layer.ffn.linear_1.weight = take(f"{at}.DenseReluDense.wo")
    spec.decoder.projection.weight = shared
    spec.decoder.scale_outputs = CONFIG["d_model"] ** -0.5
    tokens = ["<pad>", "</s>", "<unk>"] + [f"t{i}" for i in range(3, CONFIG["vocab_size"])]
    spec.register_source_vocabulary(tokens)
    spec.register_target_vocabulary(tokens)
    spec.config.bos_token = spec.config.decoder_start_token = "<pad>"
    spec.config.eos_token, spec.config.unk_token = "</s>", "<unk>"
    spec.validate()
    spec.optimize(quantization=quantization)
    folder.mkdir(parents=True)
    spec.save(str(folder))


def main():
    folder = Path(sys.argv[1])
    kind = sys.argv[2] if len(sys.argv) > 2 else "int8"
    weights_file = folder / "model.safetensors"
    if not weights_file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        save_file(draw(), weights_file)
        (folder / "config.json").write_text(json.dumps(CONFIG))
    model = folder / f"ctranslate2-{kind}"
    if not model.exists():
        convert(load_file(weights_file), model, kind)
    translator = ctranslate2.Translator(
        str(model), device="cpu", compute_type=kind, inter_threads=1, intra_threads=1
    )
    for batch in (1, 16):
        # The inputs of the example `bench`.
        ids = [[3 + (r * SOURCE + i) * 7919 % 32000 for i in range(SOURCE)] for r in range(batch)]
        source = [[f"t{i}" for i in row] for row in ids]

        def run():
            return translator.translate_batch(
                source, beam_size=1, max_batch_size=batch, min_decoding_length=NEW, max_decoding_length=NEW
            )

        run()
        times = []
        for _ in range(RUNS):
            start = time.process_time()
            said = run()
            times.append(1e3 * (time.process_time() - start))
        tokens = [len(r.hypotheses[0]) for r in said]
        assert tokens == [NEW] * batch, tokens
        median = statistics.median(times)
        print(
            f"ctranslate2 {ctranslate2.__version__} {kind} threads 1 batch {batch:2}: median {median:7.1f} ms, "
            f"least {min(times):7.1f} ms, {1e3 * batch * NEW / median:6.0f} tokens/s; "
            f"first {said[0].hypotheses[0][:6]}"
        )


main()
