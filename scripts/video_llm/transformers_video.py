"""Answers the prompts of `radarllm baselines render` with Video-LLaVA, by Hugging Face transformers.

    pip install av blake3 numpy torch transformers accelerate
    python scripts/video_llm/transformers_video.py renders answers.jsonl --revision COMMIT

COMMIT is the commit of the weights' repository, so that a row names the weights that it is of. Answers are appended as they
come, and the same command continues. This script was not run by this project. It needs a GPU: in half precision, seven
billion weights alone take 14 GB.
"""

import argparse
import json
import pathlib

import av
import blake3
import numpy as np
import torch
import transformers
from transformers import VideoLlavaForConditionalGeneration, VideoLlavaProcessor

N_FRAMES = 8
MAX_NEW_TOKENS = 512


def frames_of(path):
    """`N_FRAMES` frames of a video, evenly spaced from the first to the last: uint8 (frame, row, column, colour)."""
    with av.open(str(path)) as video:
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    chosen = np.linspace(0, len(frames) - 1, N_FRAMES).round().astype(int)
    return np.stack([frames[i] for i in chosen])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("renders", type=pathlib.Path, help="folder of `radarllm baselines render`, of AVI files")
    parser.add_argument("answers", type=pathlib.Path, help="JSON Lines to write")
    parser.add_argument("--model", default="LanguageBind/Video-LLaVA-7B-hf", help="repository of the weights")
    parser.add_argument("--revision", required=True, help="commit of that repository")
    args = parser.parse_args()

    prompts = [json.loads(line) for line in (args.renders / "prompts.jsonl").read_text("utf-8").splitlines()]
    done = set()
    if args.answers.exists():
        done = {json.loads(line)["id"] for line in args.answers.read_text("utf-8").splitlines()}
    processor = VideoLlavaProcessor.from_pretrained(args.model, revision=args.revision)
    model = VideoLlavaForConditionalGeneration.from_pretrained(
        args.model, revision=args.revision, torch_dtype=torch.float16, device_map="auto"
    )
    with args.answers.open("a", encoding="utf-8") as answers:
        for prompt in prompts:
            if prompt["id"] in done:
                continue
            path = args.renders / prompt["video"]
            text = f"USER: <video>\n{prompt['prompt']} ASSISTANT:"
            inputs = processor(text=text, videos=frames_of(path), return_tensors="pt").to(model.device, torch.float16)
            with torch.inference_mode():
                ids = model.generate(**inputs, do_sample=False, max_new_tokens=MAX_NEW_TOKENS)
            new = ids[:, inputs["input_ids"].shape[1] :]
            answer = {
                "id": prompt["id"],
                # As the model said it; nothing is cleaned.
                "text": processor.batch_decode(new, skip_special_tokens=True)[0],
                "blake3": blake3.blake3(path.read_bytes()).hexdigest(),
                "model": args.model,
                "weights": f"{args.model}@{args.revision}",
                "commit": f"transformers {transformers.__version__}",
            }
            print(json.dumps(answer, ensure_ascii=False), file=answers, flush=True)


if __name__ == "__main__":
    main()
