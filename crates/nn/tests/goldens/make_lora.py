"""Golden adapters and logits of the GPT-2 and Qwen2 of make_hf.py with LoRA and new rows.

    pip install torch==2.15.0 transformers==5.23.0 safetensors==0.8.0
    python make_lora.py .

Reads gpt2.safetensors and qwen2.safetensors of the folder and writes lora_gpt2.safetensors and lora_qwen2.safetensors:
adapters under PEFT's names, the rows of new ids as `<embedding>.added`, `input_ids` and `output`, the logits, all f32.
The adapter is computed here and not by PEFT: x W + b + (alpha / r) x A B, with A and B transposed in the file.
"""

import json
import sys

import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from transformers import GPT2Config, GPT2LMHeadModel, Qwen2Config, Qwen2ForCausalLM

RANK, ALPHA, NEW_ROWS = 3, 6.0, 5


class Adapted(torch.nn.Module):
    def __init__(self, base, n_in, n_out, generator):
        super().__init__()
        self.base = base
        self.a = 0.5 * torch.randn(n_in, RANK, generator=generator)
        self.b = 0.5 * torch.randn(RANK, n_out, generator=generator)

    def forward(self, x):
        return self.base(x) + ALPHA / RANK * (x @ self.a @ self.b)


@torch.no_grad()
def main(folder):
    for name, config_type, model_type in [
        ("gpt2", GPT2Config, GPT2LMHeadModel), ("qwen2", Qwen2Config, Qwen2ForCausalLM),
    ]:
        path = f"{folder}/{name}.safetensors"
        with safe_open(path, "pt") as file:
            config = config_type(**json.loads(file.metadata()["config"]))
        model = model_type(config)
        weights = {k: v for k, v in load_file(path).items() if k not in ("input_ids", "attention_mask", "output")}
        missing, unexpected = model.load_state_dict(weights, strict=False)
        assert not unexpected and set(missing) <= {"lm_head.weight"}, (missing, unexpected)
        model.tie_weights()
        model.eval()

        generator = torch.Generator().manual_seed(7)
        tensors = {}
        n_old = config.vocab_size
        model.resize_token_embeddings(n_old + NEW_ROWS, mean_resizing=False)
        embeddings = {"gpt2": ["transformer.wte"], "qwen2": ["model.embed_tokens", "lm_head"]}[name]
        for embedding in embeddings:
            weight = model.get_submodule(embedding).weight
            rows = torch.randn(NEW_ROWS, weight.shape[1], generator=generator)
            weight[n_old:] = rows
            tensors[f"{embedding}.added"] = rows

        targets = {"gpt2": ["c_attn"], "qwen2": ["q_proj", "v_proj"]}[name]
        for path, module in list(model.named_modules()):
            parent, _, last = path.rpartition(".")
            if last not in targets:
                continue
            n_in, n_out = module.weight.shape if name == "gpt2" else reversed(module.weight.shape)
            adapted = Adapted(module, n_in, n_out, generator)
            setattr(model.get_submodule(parent), last, adapted)
            tensors[f"base_model.model.{path}.lora_A.weight"] = adapted.a.T.contiguous()
            tensors[f"base_model.model.{path}.lora_B.weight"] = adapted.b.T.contiguous()

        ids = torch.randint(0, n_old + NEW_ROWS, (2, 11), generator=generator)
        ids[:, 3:6] = torch.arange(n_old, n_old + 3)  # New ids in every row.
        tensors["input_ids"] = ids.float()
        tensors["output"] = model(input_ids=ids).logits.contiguous()
        save_file(tensors, f"{folder}/lora_{name}.safetensors", metadata={"rank": str(RANK), "alpha": str(ALPHA)})


if __name__ == "__main__":
    main(sys.argv[1])
