"""Golden weights and outputs of tiny random GPT-2, Qwen2, BERT, RoBERTa and left-padded T5 networks.

    pip install torch==2.15.0 transformers==5.23.0 safetensors==0.8.0
    python make_hf.py .

Writes one safetensors file a network: its weights under their checkpoint names, `config` as JSON metadata,
`input_ids`, `attention_mask` (and `decoder_input_ids` for T5), and `output`: logits, or hidden states for the encoders,
all f32. Rows are padded left or right. Outputs at padded positions mean nothing and are set to zero.
"""

import json
import sys

import torch
from safetensors.torch import save_file
from transformers import (
    BertConfig, BertModel, GPT2Config, GPT2LMHeadModel, Qwen2Config, Qwen2ForCausalLM, RobertaConfig, RobertaModel,
    T5Config, T5ForConditionalGeneration,
)


def save(path, model, config, inputs, output, dropped=()):
    shown = inputs.get("decoder_input_ids", inputs["input_ids"])
    mask = inputs["attention_mask"] if shown is inputs["input_ids"] else torch.ones_like(shown)
    tensors = {k: v.contiguous().clone().float() for k, v in model.state_dict().items()
               if v.is_floating_point() and k not in dropped}
    tensors |= {k: v.float() for k, v in inputs.items()}
    tensors["output"] = (output * mask[:, :, None]).contiguous()
    save_file(tensors, path, metadata={"config": json.dumps(config.to_dict(), default=str)})


def shaken(model, seed):
    """Gains and offsets away from one and zero, so that nothing can hide behind the initial values."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for p in model.parameters():
            p.mul_(1 + 0.3 * torch.randn(p.shape, generator=generator))
            p.add_(0.1 * torch.randn(p.shape, generator=generator))
    return model.eval()


def ids(seed, rows, length, padding, left, vocab=40, pad=0):
    generator = torch.Generator().manual_seed(seed)
    out = torch.randint(3, vocab, (rows, length), generator=generator)
    mask = torch.ones_like(out)
    where = slice(0, padding) if left else slice(length - padding, length)
    out[-1, where] = pad
    mask[-1, where] = 0
    return {"input_ids": out, "attention_mask": mask}


@torch.no_grad()
def main(folder):
    config = GPT2Config(vocab_size=40, n_embd=16, n_layer=2, n_head=2, n_positions=24, n_inner=None)
    model = shaken(GPT2LMHeadModel(config), 1)
    inputs = ids(1, 2, 12, 3, left=True)
    save(f"{folder}/gpt2.safetensors", model, config, inputs, model(**inputs).logits, {"lm_head.weight"})

    config = Qwen2Config(vocab_size=40, hidden_size=24, intermediate_size=36, num_hidden_layers=2, num_attention_heads=4,
                         num_key_value_heads=2, tie_word_embeddings=False, max_position_embeddings=64)
    model = shaken(Qwen2ForCausalLM(config), 2)
    inputs = ids(2, 2, 20, 5, left=True)
    save(f"{folder}/qwen2.safetensors", model, config, inputs, model(**inputs).logits)

    config = BertConfig(vocab_size=40, hidden_size=16, num_hidden_layers=2, num_attention_heads=2, intermediate_size=24,
                        max_position_embeddings=32)
    model = shaken(BertModel(config), 3)
    inputs = ids(3, 2, 14, 4, left=False)
    save(f"{folder}/bert.safetensors", model, config, inputs, model(**inputs).last_hidden_state)

    config = RobertaConfig(vocab_size=40, hidden_size=16, num_hidden_layers=2, num_attention_heads=2, intermediate_size=24,
                           max_position_embeddings=34, type_vocab_size=1, pad_token_id=1)
    model = shaken(RobertaModel(config), 4)
    inputs = ids(4, 2, 14, 4, left=False, pad=1)
    save(f"{folder}/roberta.safetensors", model, config, inputs, model(**inputs).last_hidden_state)

    config = T5Config(vocab_size=40, d_model=16, d_kv=6, num_heads=2, d_ff=24, num_layers=2, num_decoder_layers=2,
                      feed_forward_proj="gated-gelu", tie_word_embeddings=False, decoder_start_token_id=0)
    model = shaken(T5ForConditionalGeneration(config), 5)
    inputs = ids(5, 2, 200, 30, left=True)
    inputs["decoder_input_ids"] = ids(6, 2, 150, 0, left=True)["input_ids"]
    dropped = {"encoder.embed_tokens.weight", "decoder.embed_tokens.weight"}
    save(f"{folder}/t5_left.safetensors", model, config, inputs, model(**inputs).logits, dropped)


if __name__ == "__main__":
    main(sys.argv[1])
