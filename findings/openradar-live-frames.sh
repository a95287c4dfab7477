#!/usr/bin/env bash
# OpenRadar's live reader returns every second frame, each of them shifted further.
#
# Guess: `DCA1000.read()` returns consecutive frames, aligned to their first chirp.
# What happens: it looks for frame starts at multiples of whole packets (540 x 1456 bytes for its default of 128 loops,
# 3 transmitters, 4 receivers and 128 samples), not of the frame (786432 bytes = 540.13 packets). Every frame therefore
# starts 192 bytes too early per elapsed frame, and its last 192 bytes are zero. The packet that ends a frame is thrown
# away, though it is the first of the next, so that frame is skipped. No packet was lost here; `lost_packets` says -1.
# Why it matters: half of the frame rate is gone, and chirps drift through the cube: after three frames every receiver
# has samples of another. Frames of a power of two bytes are never whole packets of 1456.
# What to do: place packets by the byte counter, as radarllm does (docs/guides/captures.md, "Packet loss"), or record first.
source "$(dirname "$0")/lib.sh"
install numpy==1.26.4 scipy==1.13.1 scikit-learn==1.5.2 openradar==1.0.1
observe <<'PYTHON'
import struct

import numpy as np
from mmwave.dataloader import DCA1000, adc

from finding import report

# Seven frames whose words say which frame they belong to (1 to 7), in packets as the card sends them, none missing.
stream = np.repeat(np.arange(1, 8, dtype=np.int16), adc.BYTES_IN_FRAME // 2).tobytes()
packets = [
    struct.pack("<I", number + 1) + struct.pack("<Q", at)[:6] + stream[at : at + 1456]
    for number, at in enumerate(range(0, len(stream), 1456))
]


class Card:
    """Stands in for the data socket: hands out one packet after another."""

    def settimeout(self, _):
        pass

    def recvfrom(self, _):
        if not packets:
            raise TimeoutError
        return packets.pop(0), None


reader = DCA1000("127.0.0.1", "127.0.0.1", 0, 0)
reader.data_socket.close()
reader.data_socket = Card()
observed = []
try:
    while True:
        words = reader.read().astype(int)
        counts = {int(n): int((words == n).sum()) for n in np.unique(words)}
        observed.append(f"words of each frame in what was returned (0: nothing): {counts}, lost_packets {reader.lost_packets}")
except TimeoutError:
    pass
finally:
    reader.config_socket.close()
report(
    "seven frames (the last may be missing) of 393216 words each, lost_packets 0",
    observed,
    [
        "words of each frame in what was returned (0: nothing): {0: 96, 1: 393120}, lost_packets -1",
        "words of each frame in what was returned (0: nothing): {0: 96, 2: 192, 3: 392928}, lost_packets -1",
        "words of each frame in what was returned (0: nothing): {0: 96, 4: 384, 5: 392736}, lost_packets -1",
        "words of each frame in what was returned (0: nothing): {0: 96, 6: 576, 7: 392544}, lost_packets -1",
    ],
)
PYTHON
