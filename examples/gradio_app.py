"""A web page that describes built-in motions and recordings: `pip install gradio`, then `python examples/gradio_app.py`."""

import gradio as gr

import radarllm as rl

model = rl.Model()


def describe(motion: str, recording: str | None, radar: str):
    try:
        if recording:
            with rl.open_capture(recording, radar=radar) as capture:
                points = capture.points()
        else:
            points = rl.simulate(motion, radar=radar)
        sentence = model.describe(points)
    except rl.Error as error:
        raise gr.Error(str(error)) from error
    return f"{sentence} ({sentence.provenance}, confidence {sentence.confidence:.2f})", sentence._repr_html_()


motions = ["builtin:walk?direction=backward", "builtin:wave?side=left", "builtin:sit_down"]
inputs = [gr.Dropdown(motions, label="Motion", allow_custom_value=True), gr.File(label="Recording"), gr.Textbox("awr1843boost", label="Radar")]
gr.Interface(describe, inputs, [gr.Textbox(label="Sentence"), gr.HTML()], title="RadarLLM").launch()
